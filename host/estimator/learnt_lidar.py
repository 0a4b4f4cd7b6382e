"""What the lidar finds of teammates, and its false readings, learnt from the filter's associations.

The detection probability in plain view is learnt from teammates that are surely there: how many
readings were theirs, over how many the configuration makes expect. The clutter is learnt from the
readings that nothing known explains. Both begin as configured, worth so many observations, are
forgotten slowly and stay within bounds: a detection probability is only lowered, for a low one may
be configured because misses come in runs. In a lidar as configured both stay as they are.
"""

import math

import numpy as np

from host.config import Lidar
from host.estimator.evidence import new_share
from host.estimator.sensor_models import LidarModel
from host.messages import FloatArray

_SURE = 0.95  # probability of a teammate from which it counts
_PLAIN_VIEW = 0.6  # of the detection probability close by: less is no plain view
_PRIOR_CHANCES, _PRIOR_FALSE = 50.0, 10.0  # what the configuration is worth
_FORGOTTEN_S = 120.0
_SCANS_S = 0.3  # misses within it are not independent
_LEAST = 0.3  # detection probability, unless less is configured
# Things that begin, and those that are seldom found, make up to twice the clutter of a sound lidar.
_USUAL_RATIO, _MOST_RATIO = 3.0, 10.0
_FAR_OFF, _FAR_OFF_RATIO = 0.15, 4.0  # from here on it is reported
_KNOWN_CHANCES = 100.0


class LearntLidar(LidarModel):
    """The lidar's model, with the detection probability close by and the clutter as learnt."""

    def __init__(self, config: Lidar) -> None:
        super().__init__(config)
        self._found = self._expected = 0.0  # readings of sure teammates in plain view
        self._false = self._usual = 0.0  # unexplained readings, and what they would be as usual

    def learn(
        self, teammates: FloatArray, expected: FloatArray, found: FloatArray, elapsed: float
    ) -> None:
        """Take in a scan's associations; elapsed: s since the scan before.

        teammates, expected, found (n,): the probabilities that a thing is a teammate, that it gives
        a reading, by the model, and that it gave one.
        """
        kept, share = math.exp(-elapsed / _FORGOTTEN_S), new_share(elapsed, _SCANS_S)
        plain = (teammates > _SURE) & (expected > _PLAIN_VIEW * self.close_by)
        found, expected = found[plain], expected[plain]
        configured = self._config.detection_probability
        self._found = kept * self._found + share * float(found.sum())
        chances = float(expected.sum()) * configured / self.close_by
        self._expected = kept * self._expected + share * chances
        learnt = configured * (_PRIOR_CHANCES + self._found) / (_PRIOR_CHANCES + self._expected)
        self.close_by = min(max(learnt, _LEAST), configured)

    def learn_clutter(
        self, unexplained: float, clearance: FloatArray | None, elapsed: float
    ) -> None:
        """Take in how many readings of a scan nothing known explains; clearance: the scan's own."""
        kept = math.exp(-elapsed / _FORGOTTEN_S)
        self._false = kept * self._false + unexplained
        self._usual = kept * self._usual + self._config.clutter_per_m2 * self._area_m2(clearance)
        ratio = min(max(self._ratio() - _USUAL_RATIO, 1.0), _MOST_RATIO)
        self.clutter = self._config.clutter_per_m2 * ratio

    def _area_m2(self, clearance: FloatArray | None) -> float:
        """What the lidar looks over."""
        reach = self._config.max_range_m
        if clearance is None:
            return 0.5 * self._config.field_of_view_rad * reach * reach
        seen = np.minimum(clearance, reach)
        return float(0.5 * math.tau * np.mean(seen * seen))

    def _ratio(self) -> float:
        return (_PRIOR_FALSE + self._false) / (_PRIOR_FALSE + self._usual)

    @property
    def known(self) -> bool:
        """Whether there was enough to learn the detection probability from."""
        return self._expected > _KNOWN_CHANCES

    def summary(self) -> str:
        """What was learnt, as text."""
        return (
            f"the lidar finds {self.close_by:.0%} of the teammates in plain view, "
            f"{self._config.detection_probability:.0%} are configured"
        )

    def fault(self) -> str | None:
        """What is far from the configuration, with the next step; None where nothing is."""
        if self.close_by < self._config.detection_probability - _FAR_OFF:
            return (
                f"{self.summary()}; estimates allow for it: clean the lidar's window, then fit "
                "detection_probability by `swarmloc calibrate detection`"
            )
        if self._ratio() > _FAR_OFF_RATIO:
            return (
                f"the lidar has {self._ratio():.0f} times the false readings that clutter_per_m2 "
                "in [lidar] makes expect; estimates allow for some: clean its window, keep the "
                "sun out, then fit it by `swarmloc calibrate detection`"
            )
        return None
