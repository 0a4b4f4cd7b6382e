"""A PHD filter on a robot that stands still, and what its sensors tell it."""

import numpy as np

from host.estimator.phd import PhdFilter
from host.messages import Bearings, Displacement, Positions

RATE_HZ = 7.0
PLAIN_VIEW = np.full(360, 100.0)  # the lidar sees past everything
MOST = 1.02  # neither kind of thing is ever ruled out, which may add a hundredth


def seen(time, points, sigma=0.01, clearance=PLAIN_VIEW, lags=None):
    points = np.reshape(np.asarray(points, dtype=float), (-1, 2))
    noise = np.tile(sigma**2 * np.eye(2), (len(points), 1, 1))
    return Positions(time, points, noise, lags, clearance)


def heard(time, bearings, sigma=0.0873, origin=(0.0, 0.0), lag=0.0):
    bearings = np.atleast_1d(np.asarray(bearings, dtype=float))
    return Bearings(time, bearings, np.full(len(bearings), sigma**2), origin, lag)


def standing(time, interval):
    return Displacement(time, interval, 0.0, 0.0, 0.0)


class Run:
    """A filter on a robot that stands still, and its clock."""

    def __init__(self, settings=None, lidar=None, camera=None):
        self.filter = PhdFilter(settings, lidar, camera)
        self.time = 0.0

    def wait(self, interval=1.0 / RATE_HZ):
        self.time += interval
        self.filter.predict(standing(self.time, interval))

    def scan(self, points, **how):
        self.wait()
        self.filter.update(seen(self.time, points, **how))
        return self.filter.estimate()

    def look(self, points, **how):
        """A scan and an image of the same instant."""
        self.scan(points, **how)
        x, y = np.reshape(np.asarray(points, dtype=float), (-1, 2)).T
        self.filter.update(heard(self.time, np.arctan2(y, x)))
        return self.filter.estimate()

    def image(self, bearings, **how):
        self.wait()
        self.filter.update(heard(self.time, bearings, **how))
        return self.filter.estimate()

    def estimate(self):
        return self.filter.estimate()
