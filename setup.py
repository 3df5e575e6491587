"""Version, licence, packages and data of the library without ROS; everything else is in pyproject.toml.

On a machine with ROS 2 the package is built by colcon (CMakeLists.txt); this file plays no part there.
"""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from setuptools import Extension, find_packages, setup

MANIFEST = ElementTree.parse(Path(__file__).with_name("package.xml")).getroot()
DATA = {f"tactile_localizer.share.{folder}": folder for folder in ("config", "msg")}
"""Where :func:`tactile_localizer.resources.resource_path` finds the folders of the source tree."""

AS_VECTORS = ("-fassociative-math", "-fno-math-errno", "-fno-signed-zeros", "-fno-trapping-math")
COMPILED = Extension(
    "tactile_localizer._compiled",
    ["src/compiled.c"],
    extra_compile_args=["-O3", *AS_VECTORS],
    libraries=["m"],
    optional=True,
)
"""Without a compiler or Python's headers the package is installed all the same, and numpy does its work."""

setup(
    version=MANIFEST.findtext("version"),
    license=MANIFEST.findtext("license"),
    packages=[*find_packages(include=["tactile_localizer", "tactile_localizer.*"]), *DATA],
    package_dir=DATA,
    ext_modules=[COMPILED],
    package_data={
        "tactile_localizer": ["py.typed", "offline/reports/templates/*"],
        **{package: ["*", "*/*"] for package in DATA},
    },
)
