"""What a person reads after a run: counts, figures with units, or the reason there are none."""

import re

import numpy as np

from host.cli.terminal.summary import summary, written
from host.messages import Estimate, Health, Names
from host.sessions.figures import Tally, timing


def test_a_summary_has_counts_or_the_reason_there_are_none():
    tally = Tally()
    tally.take(Health(1.0, "lidar", True, "scanning", {"revolutions": 7, "revolutions_torn": 0}))
    tally.take(Health(1.0, "board", False, "not found\nplug it in", {"frames": 0}))
    assert told({"seconds": 3.0, **tally.figures(), "devices": tally.devices()}) == {
        "time": "3.0 s",
        "updates": "none: nothing was measured",
        "lidar": "ok: 7 revolutions, 2.3/s",
        "board": "FAIL: not found; plug it in",
    }


def told(figures):
    """The lines of a summary by what stands first on them, after checks of its form."""
    lines = summary(figures).splitlines()
    assert lines[0] == "Summary"
    assert max(map(len, lines)) <= 80
    unfolded = re.sub(r"\n {6,}", " ", "\n".join(lines[1:]))
    return dict(line.split(maxsplit=1) for line in unfolded.splitlines())


RUN = {
    "seconds": 12.1,
    "updates": 201,
    "teammates_reported": 2.731,
    "teammates_in_range": 2.841,
    "mean_error_mm": 45.192,
    "updates_per_s": 16.6,
    "update_ms_median": 0.552,
    "update_ms_p99": 4.638,
    "latency_ms": {
        "lidar": {"median": 21.6, "p99": 40.2},
        "camera": {"median": 151.0, "p99": 162.0},
    },
    "cpu_share_of_one_core": 0.22,
    "devices": {},
}


def test_a_run_is_told_in_words_with_units():
    assert told(RUN) == {
        "time": "12.1 s",
        "teammates": "2.7 reported on average; true, within 2.0 m: 2.8",
        "error": "45 mm mean, over estimates matched to a teammate",
        "updates": "201 (16.6/s), 0.55 ms median, 4.6 ms p99",
        "latency": "lidar 22 ms median, 40 ms p99; camera 151 ms median, 162 ms p99",
        "load": "0.22 of one core",
    }
    assert told({**RUN, "mean_error_mm": None})["error"].startswith("unknown")


def test_a_run_over_the_link_is_told_with_who_was_recognized():
    tally = Tally()
    none, label = np.zeros(0), np.array([4])
    place = np.zeros((1, 2)), np.zeros((1, 2, 2)), np.ones(1), np.zeros(1), label
    tally.take(Names(0.9, none.astype(int), none.astype(int), none, none))
    tally.take(Estimate(1.0, *place))
    assert tally.figures()["recognized"] == []
    tally.take(Names(1.0, label, np.array([2]), np.ones(1), np.zeros(1)))
    tally.take(Estimate(1.2, *place))
    lines = told({**RUN, **tally.figures()})
    assert lines["names"] == "robot 2 recognized; 50 % of reports named"


def test_a_replay_is_told_with_its_score():
    figures = {
        "seconds": 6.9,
        "times_real_time": 9.7,
        "updates": 118,
        "teammates_reported": 2.695,
        **timing([0.001]),
        "gospa_m": 0.389,
        "localisation_m": 0.054,
        "missed": 0.786,
        "false": 0.429,
        "rmse_m": 0.038,
        "devices": {},
        "recorded_estimates": "118 bit-identical, 0 different from the recorded",
        "recording": "its last line is torn: the run was cut short",
    }
    assert told(figures) == {
        "time": "6.9 s, replayed at 9.7 times real time",
        "teammates": "2.7 reported on average",
        "error": "38 mm RMSE, over estimates matched to a teammate",
        "score": "GOSPA 0.389 m (localisation 54 mm), 0.79 missed, 0.43 false a scan",
        "updates": "118, 1.00 ms median, 1.0 ms p99",
        "estimates": "118 bit-identical, 0 different from the recorded",
        "recording": "its last line is torn: the run was cut short",
    }
    assert told({**figures, "rmse_m": None})["error"].startswith("unknown")
    unscored = dict.fromkeys(("gospa_m", "localisation_m", "missed", "false", "rmse_m"))
    lines = told({**figures, **unscored})
    assert lines["score"].startswith("none")
    assert "error" not in lines


def device(counts, ok=True, reason="scanning"):
    return told(
        {**RUN, "seconds": 10.0, "devices": {"it": {"ok": ok, "reason": reason, "counts": counts}}}
    )["it"]


def test_a_device_is_told_with_its_rate_and_what_went_wrong():
    lidar = {"bytes": 9000, "packets": 1000, "revolutions": 70, "replies": 1, "connections": 1}
    assert device(lidar) == "ok: 70 revolutions, 7.0/s"
    worse = {
        **lidar,
        "checksum_errors": 20,
        "points": 900,
        "points_lost": 100,
        "revolutions_torn": 1,
    }
    assert device({**worse, "connections": 3}) == (
        "ok: 70 revolutions, 7.0/s; reconnected 2 times, 2 % of packets damaged, 10 % of points "
        "lost, 1 revolution torn"
    )
    # Frames that were lost or damaged are not among those that came.
    assert device({"frames": 99, "lost": 1}).endswith("; 1 % of frames lost")
    assert device({"frames": 10, "late": 3}).endswith("; 3 late")
    assert device({}, reason="30 kB/s") == "ok: 30 kB/s"
    gone = {"frames": 5, "connections": 2}
    assert device(gone, False, "it is gone") == "FAIL: it is gone (reconnected once)"
    assert device({"frames": 5}, False, "it is gone") == "FAIL: it is gone"


def test_what_was_written_is_told_in_words():
    lines = written(
        {
            "recording": "a.mcap",
            "seconds": 20.0,
            "times_real_time": 9.3,
            "megabytes": 0.6,
            "bodies_messages": 341,
        }
    )
    assert lines.splitlines() == [
        "  recording       a.mcap",
        "  time            20.0 s, simulated at 9.3 times real time",
        "  size            0.6 MB",
        "  motion capture  341 messages",
    ]
    assert written({"output": "a", "scan_rows": 3}) == "  written to  a\n  scan.csv    3 rows"
