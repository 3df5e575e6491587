"""Names of the installed launch files, checked without ``launch``."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_base_names_of_installed_launch_files_are_unique() -> None:
    """``ros2 launch`` searches the whole share directory, and refuses a name that it finds twice."""
    installed = re.findall(
        r"install\(DIRECTORY (.*) DESTINATION share/", (ROOT / "CMakeLists.txt").read_text()
    )
    folders = [ROOT / folder for folder in " ".join(installed).split()]
    names = [path.name for folder in folders for path in folder.rglob("*.launch.py")]
    assert "bringup.launch.py" in names
    assert sorted(names) == sorted(set(names))
