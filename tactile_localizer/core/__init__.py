"""The mathematics: numpy and scipy only; no clock, no files, no ROS, no global random state."""
