"""What the counts of the last seconds say beside a device's health."""

from host.drivers.counted import WINDOW_S
from host.drivers.health import HealthReporter
from host.messages import Health


class Device:
    def __init__(self) -> None:
        self.now = 100.0
        self.health: list[Health] = []
        self.reporter = HealthReporter("lidar", lambda: self.now)

    def says(self, ok: bool = True, seconds: float = 1.0, **counts: int) -> str:
        """What it reports after some seconds."""
        self.now += seconds
        self.reporter.report(self.health.append, ok, "how it does", lambda: counts, certain=True)
        return self.health[-1].reason


def test_damaged_packets_are_said_where_they_are_more_than_a_hundredth() -> None:
    device = Device()
    assert device.says(packets=1000, checksum_errors=500) == "how it does"  # of before it was ok
    assert device.says(packets=2000, checksum_errors=510) == "how it does"
    said = device.says(packets=3000, checksum_errors=521)
    assert said.startswith("how it does; 21 of 2000 packets had a wrong checksum: use a short")
    for second in range(round(WINDOW_S) + 2):
        said = device.says(packets=4000 + 1000 * second, checksum_errors=521)
    assert said == "how it does"  # it is long ago


def test_a_lost_connection_is_said_once_it_is_back() -> None:
    device = Device()
    device.says(ok=False, connections=0)
    assert device.says(connections=1) == "how it does"
    assert device.says(ok=False, connections=1) == "how it does"
    said = device.says(connections=2)
    assert said.startswith("how it does; its connection was lost once and came back: check")
    assert "lost 2 times" in device.says(connections=3)


def test_counts_of_other_devices_by_the_same_names_mean_nothing() -> None:
    device = Device()
    device.says(heard=0, repeated=0, clock_restarts=0)
    assert device.says(heard=10, repeated=9, clock_restarts=3) == "how it does"


def test_a_changed_count_alone_is_no_change_of_state() -> None:
    """It is told once a second, however often it is asked for."""
    device = Device()
    for k in range(50):
        device.says(seconds=0.02, packets=100 + k, checksum_errors=k)
    assert len(device.health) == 2
