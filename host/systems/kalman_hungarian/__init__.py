"""Belaroussi 2024: three ways to detect robots with a lidar, and their fusion with a camera."""
