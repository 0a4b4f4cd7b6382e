"""What a person reads after squares: figures in words, and what they mean for robot.toml."""

from host.cli.drive_square import as_text

FIGURES = {
    "systematic_error_mm": 40.0,
    "spread_mm": 10.0,
    "corner_error_deg": -0.119,
    "side_bend_deg": 1.216,
    "wheel_ratio": 1.006,
    "track_ratio": 0.999,
    "corrected_left_radius_m": 0.0324,
    "corrected_right_radius_m": 0.0326,
    "corrected_track_m": 0.1438,
}
LINES = "left_radius_m = 0.0324\n  right_radius_m = 0.0326\n  track_m = 0.1438"


def test_an_error_beyond_its_spread_gives_the_lines_of_robot_toml():
    text = as_text(FIGURES, 5)
    assert text.endswith(f"write this into robot.toml:\n  [wheels]\n  {LINES}")
    assert not any(key in text.partition("[wheels]")[0] for key in FIGURES)


def test_an_error_within_its_spread_keeps_robot_toml():
    # The mean of four scatters by half of 30 mm: 40 mm are within three of these.
    text = as_text({**FIGURES, "spread_mm": 30.0}, 4)
    assert "keep robot.toml" in text
    assert "[wheels]" not in text


def test_one_square_each_way_asks_for_more():
    assert "--runs 5" in as_text({**FIGURES, "spread_mm": 0.0}, 1)
