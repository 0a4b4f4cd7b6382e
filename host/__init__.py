"""swarmloc: where each teammate is, from one robot's own lidar, cameras and wheel encoders."""
