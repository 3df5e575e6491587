"""Packages and data of the library without ROS; everything else is in pyproject.toml.

On a machine with ROS 2 the package is built by colcon (CMakeLists.txt); this file plays no part there.
"""

from setuptools import find_packages, setup

setup(
    packages=[*find_packages(include=["tactile_localizer", "tactile_localizer.*"]), "tactile_localizer.config"],
    package_dir={"tactile_localizer.config": "config"},
    package_data={"tactile_localizer": ["py.typed"], "tactile_localizer.config": ["*", "*/*"]},
)
