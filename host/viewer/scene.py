"""The stream's messages: one JSON object with everything known now (docs/stream.md)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from host.config import RobotConfig
from host.geometry import Path, wrap
from host.localizer import carried
from host.messages import (
    Bearings,
    Displacement,
    Estimate,
    FloatArray,
    Health,
    Message,
    Named,
    Now,
    Positions,
    Scan,
    Truth,
)
from host.perception.turrets.segments import place
from host.viewer.playback import Playback

SCHEMA = "swarmloc.stream/1"
VALID_S = 0.5  # without a newer message for this long, the stream is lost
_SHOWN_S = 1.0  # a scan or bearings older than this are no longer shown


class Scene:
    """The newest messages, transformed into the robot frame of one moment.

    Call `take` and `message` in the localizer's thread.
    """

    def __init__(
        self,
        config: RobotConfig,
        filter_name: str,
        pictures: Sequence[str] = (),
        playback: Playback | None = None,
    ) -> None:
        """pictures: the cameras whose pictures a reader can ask for; playback: of a replay."""
        self.pictures = pictures
        self.playback = playback
        self._config = config
        self._filter_name = filter_name
        self.clear()

    def clear(self) -> None:
        """Forget all that was taken: a replay restarts."""
        self._path = Path()
        self._scan: Scan | None = None
        self._candidates: Positions | None = None
        self._bearings: dict[str, Bearings] = {}
        self._devices: dict[str, Health] = {}

    def take(self, message: Message) -> None:
        """Receive a message."""
        if isinstance(message, Displacement):
            self._path.append(message)
        elif isinstance(message, Scan):
            self._scan = message
        elif isinstance(message, Positions):
            self._candidates = message
        elif isinstance(message, Bearings):
            self._bearings[message.camera] = message
        elif isinstance(message, Health):
            self._devices[message.device] = message

    def message(self, now: Now) -> dict[str, Any]:
        """The message for readers: lengths in m, angles in rad, times in s, all at now."""
        time = now.estimate.time
        path = self._path.extended(time)
        x, y, heading = path.poses(np.array([time]))[0]
        return {
            "schema": SCHEMA,
            "time": _figure(time),
            "valid_until": _figure(time + VALID_S),
            "measured": _figure(now.measured),
            "robot": self._config.name,
            "filter": self._filter_name,
            "pose": {"x": _figure(x), "y": _figure(y), "heading": _figure(wrap(heading))},
            "estimates": _estimates(now.estimate, now.names),
            "obstacles": [{"x": _figure(x), "y": _figure(y)} for x, y in now.estimate.obstacles],
            "truth": None if now.truth is None else _truth(now.truth),
            "scan": self._scan_at(path, time),
            "candidates": self._candidates_at(path, time),
            "bearings": [
                _bearings_at(path, time, seen)
                for seen in self._bearings.values()
                if time - seen.time < _SHOWN_S
            ],
            "blind": [
                {"centre": _figure(sector.centre_rad), "width": _figure(sector.width_rad)}
                for sector in self._config.lidar.blind_sectors
            ],
            "pictures": list(self.pictures),
            "playback": None if self.playback is None else asdict(self.playback.position),
            "devices": [
                {"name": name, "ok": health.ok, "reason": health.reason, "counts": health.counts}
                for name, health in self._devices.items()
            ],
        }

    def _scan_at(self, path: Path, time: float) -> list[list[float]]:
        """The lidar's returns now, assumed stationary: [[x, y], ...]."""
        scan = self._scan
        if scan is None or time - scan.time >= _SHOWN_S:
            return []
        points, returned = place(scan, self._config.lidar, path)
        seen = points[returned]
        return _rows(path.carry(seen, np.full(len(seen), scan.time), time))

    def _candidates_at(self, path: Path, time: float) -> list[list[float]]:
        found = self._candidates
        if found is None or time - found.time >= _SHOWN_S:
            return []
        return _rows(carried(found, path, time).positions)


def _bearings_at(path: Path, time: float, seen: Bearings) -> dict[str, Any]:
    now = carried(seen, path, time)
    return {
        "camera": seen.camera,
        "age": _figure(time - seen.time),
        "x": _figure(now.origin[0]),
        "y": _figure(now.origin[1]),
        "directions": [_figure(angle) for angle in wrap(now.bearings)],
        "sigmas": [_figure(sigma) for sigma in np.sqrt(now.variances)],
        "view": {"centre": _figure(wrap(now.view[0])), "half": _figure(now.view[1])},
    }


def blobs(seen: Bearings) -> dict[str, Any]:
    """Detections in a camera's picture, to be drawn on it: pixels, rad, m.

    Nothing, where it is not known at which pixels.
    """
    found = seen.bearings[: 0 if seen.pixels is None else None]
    pixels = np.zeros((0, 2)) if seen.pixels is None else seen.pixels
    ranges = np.full(len(found), np.nan) if seen.ranges is None else seen.ranges[: len(found)]
    return {
        "camera": seen.camera,
        "time": _figure(seen.time),
        "blobs": [
            {
                "x": _figure(x),
                "y": _figure(y),
                "direction": _figure(angle),
                "range": _figure(range_m),
            }
            for (x, y), angle, range_m in zip(pixels, wrap(found), ranges, strict=True)
        ],
    }


def ellipse(covariance: FloatArray) -> tuple[float, float, float]:
    """Of a covariance (2, 2): standard deviations along its axes (m) and the major one's angle."""
    values, vectors = np.linalg.eigh(covariance)
    minor, major = np.sqrt(np.maximum(values, 0.0))
    return float(major), float(minor), math.atan2(vectors[1, 1], vectors[0, 1])


def _estimates(estimate: Estimate, names: Mapping[int, Named]) -> list[dict[str, Any]]:
    rows = []
    for k, (x, y) in enumerate(estimate.positions):
        major, minor, angle = ellipse(estimate.covariances[k])
        covariance = estimate.covariances[k]
        rows.append(
            {
                "label": int(estimate.labels[k]),
                "class": "teammate",
                "x": _figure(x),
                "y": _figure(y),
                "covariance": [
                    _fine(covariance[0, 0]),
                    _fine(covariance[0, 1]),
                    _fine(covariance[1, 1]),
                ],
                "sigmas": [_figure(major), _figure(minor)],
                "angle": _figure(angle),
                "weight": _figure(estimate.weights[k]),
                "age": _figure(estimate.ages[k]),
                "name": _name(names.get(int(estimate.labels[k]))),
            }
        )
    return rows


def _name(named: Named | None) -> dict[str, Any] | None:
    if named is None:
        return None
    return {
        "robot": named.identity,
        "probability": _figure(named.probability),
        "heading": _figure(named.heading),
    }


def _truth(truth: Truth) -> list[dict[str, Any]]:
    return [
        {"identity": int(identity), "x": _figure(x), "y": _figure(y)}
        for identity, (x, y) in zip(truth.identities, truth.positions, strict=True)
    ]


def _rows(points: FloatArray) -> list[list[float]]:
    rows: list[list[float]] = np.round(points, 3).tolist()
    return rows


def _figure(value: Any) -> float | None:
    """A number to a tenth of a millimetre; null, which JSON has, where it is not finite."""
    return round(float(value), 4) if math.isfinite(value) else None


def _fine(value: Any) -> float:
    return float(f"{float(value):.6g}")
