"""Arguments and node actions shared by the launch files."""
