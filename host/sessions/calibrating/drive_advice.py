"""What a drive still lacks to calibrate by; apart, since the fits' rooms are slow to load."""

from host.calibration.camera.calibrate import camera_advice
from host.calibration.gathered import Gathered
from host.calibration.lidar.calibrate import lidar_advice
from host.calibration.wheels.drives import wheels_advice


def drive_advice(gathered: Gathered) -> list[str]:
    """What a drive still lacks for the fits of wheels, lidar and cameras, where there are any."""
    missing = [*wheels_advice(gathered), *lidar_advice(gathered)]
    if any(seen.pixels is not None for seen in gathered.bearings):
        missing += camera_advice(gathered)
    return missing
