"""The search for strips on ordinary and hostile scenes: recall by range, false blobs, errors, cost.

Pictures are rendered, so that the truth is known: four teammates and two posts at 0.4 to 4 m, in
the rooms, lights and cameras of host/simulation/pictures/scenes.py. A strip counts for recall where
at least 95 % of it is in plain view, and as found where a bearing is within 3 deg of its own; what
is found within 3 deg of no strip in view is false.

    .venv/bin/python tools/strip_scenes.py --pattern one_colour [--hue 130] [--scenes brick,warm]
        [--pictures 40] [--seeds 1,2] [--draw FILE.jpg] [--json FILE]

Cost is the least CPU time of three passes, the median over pictures.
"""

import argparse
import json
import math
import time
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from host.calibration.camera.colour import annotate
from host.config import Cameras
from host.geometry import wrap
from host.messages import Image
from host.perception.strips.finder import StripFinder
from host.simulation.pictures.scenes import SCENES, scene_frames
from host.simulation.pictures.sightings import Sightings

RANGES_M = (0.4, 0.9, 1.7, 2.6, 4.0)
FOUND_RAD = math.radians(3.0)
WHOLE = 0.95  # share of a strip in plain view from which it has to be found
PASSES = 3
DRAWN_ROWS, DRAWN_SIZE = 640, 0.4  # of a picture, where strips are


@dataclass
class Score:
    """What a search did on pictures. hits: for each range, whether each strip was found."""

    hits: list[list[bool]] = field(default_factory=lambda: [[] for _ in RANGES_M[1:]])
    errors_deg: list[float] = field(default_factory=list)
    false: int = 0
    pictures: int = 0
    times_ms: list[float] = field(default_factory=list)

    def add(self, found: np.ndarray, truth: Sightings) -> None:
        """Judge the bearings (k,) rad found in one picture."""
        self.pictures += 1
        seen = truth.bearings[truth.shares > 0.0]
        apart = np.abs(wrap(found[:, None] - seen))
        self.false += int(np.sum(apart.min(axis=1, initial=math.inf) > FOUND_RAD))
        for k in np.flatnonzero(truth.shares >= WHOLE):
            error = np.abs(wrap(found - truth.bearings[k])).min(initial=math.inf)
            place = np.searchsorted(RANGES_M, truth.ranges[k]) - 1
            self.hits[min(max(place, 0), len(self.hits) - 1)].append(bool(error <= FOUND_RAD))
            if error <= FOUND_RAD:
                self.errors_deg.append(math.degrees(error))

    def figures(self) -> dict[str, object]:
        errors = self.errors_deg or [math.nan]
        return {
            "recall": [float(np.mean(hits)) if hits else math.nan for hits in self.hits],
            "strips": [len(hits) for hits in self.hits],
            "false_per_picture": self.false / self.pictures,
            "median_deg": float(np.median(errors)),
            "p95_deg": float(np.percentile(errors, 95)),
            "cost_ms": float(np.median(self.times_ms)),
        }


def measure(
    finder: StripFinder, name: str, seeds: list[int], count: int, cameras: Cameras
) -> Score:
    """Search the scene's pictures."""
    score = Score()
    for seed in seeds:
        for jpeg, truth in scene_frames(name, count, seed, cameras):
            spent = []
            for _ in range(PASSES):
                begin = time.process_time()
                found = finder.find(jpeg, 0.0)
                spent.append(1e3 * (time.process_time() - begin))
            score.times_ms.append(min(spent))
            score.add(np.zeros(0) if found is None else found.bearings, truth)
    return score


def drawn(finder: StripFinder, name: str, seed: int, cameras: Cameras) -> Image:
    """The scene's first picture with what is found and dropped in it, reduced."""
    jpeg, _ = next(scene_frames(name, 1, seed, cameras))
    shown = annotate(jpeg, finder.blobs(jpeg), finder.geometry)[:DRAWN_ROWS]
    shown = cv2.resize(shown, None, fx=DRAWN_SIZE, fy=DRAWN_SIZE, interpolation=cv2.INTER_AREA)
    cv2.putText(shown, name, (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 255, 255), 2)
    return np.asarray(shown, dtype=np.uint8)


def sheet(pictures: list[Image]) -> Image:
    """Pictures of one size, two in a row."""
    filled = [*pictures, np.zeros_like(pictures[0])][: len(pictures) + len(pictures) % 2]
    return np.vstack([np.hstack(filled[k : k + 2]) for k in range(0, len(filled), 2)])


def row(name: str, figures: dict) -> str:
    recall = " ".join(f"{share:5.2f}" for share in figures["recall"])
    return (
        f"{name:14} {recall} {figures['false_per_picture']:7.2f} {figures['median_deg']:8.3f} "
        f"{figures['p95_deg']:8.3f} {figures['cost_ms']:7.2f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pattern", help="of [camera.strip]; the default one if not given")
    parser.add_argument("--hue", type=float, help="of a strip of one colour, deg; red if not given")
    parser.add_argument("--scenes", default=",".join(SCENES), help="names, by commas")
    parser.add_argument("--pictures", type=int, default=40, help="of each scene and seed")
    parser.add_argument("--seeds", default="1")
    parser.add_argument("--draw", type=Path, help="draw one picture of each scene into this file")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    arguments = parser.parse_args()
    names = arguments.scenes.split(",")
    if unknown := set(names) - set(SCENES):
        parser.error(f"no scene {', '.join(sorted(unknown))}; there are {', '.join(SCENES)}")
    cv2.setNumThreads(1)
    given = {"pattern": arguments.pattern, "hue_deg": arguments.hue}
    strip = {key: value for key, value in given.items() if value is not None}
    cameras = Cameras.model_validate({"strip": strip})
    finder = StripFinder(cameras, cameras.front)
    seeds = [int(seed) for seed in arguments.seeds.split(",")]
    print(f"pattern {cameras.strip.pattern}, {arguments.pictures} pictures, seeds {seeds}")
    ranges = " ".join(f"-{far:.1f}m" for far in RANGES_M[1:])
    print(f"{'scene':14} {ranges}   false   median  p95 deg      ms")
    rows = {}
    for name in names:
        rows[name] = measure(finder, name, seeds, arguments.pictures, cameras).figures()
        print(row(name, rows[name]), flush=True)
    if arguments.draw:
        pictures = [drawn(finder, name, seeds[0], cameras) for name in names]
        cv2.imwrite(str(arguments.draw), sheet(pictures), [cv2.IMWRITE_JPEG_QUALITY, 75])
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    main()
