#!/usr/bin/env bash
# rosbags 0.11.9: the messages of a bag of several files are not in the order of their times.
#
# Each file is in order, but files are read one after the other. Where their times overlap (ros2 bag record with
# a cache, a jump of the clock, bags that were joined in a metadata.yaml) time jumps back between two messages
# of Reader.messages(); ros2 bag play merges them.
#
# Seen: times 0 2 4 1 3 5
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv venv
venv/bin/python -m pip install --quiet --disable-pip-version-check rosbags==0.11.9 ruamel.yaml==0.18.6
venv/bin/python - <<'PYTHON'
import shutil
from pathlib import Path

from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from ruamel.yaml import YAML

store = get_typestore(Stores.ROS2_JAZZY)
Text = store.types["std_msgs/msg/String"]
for name, stamps in (("one", (0, 2, 4)), ("two", (1, 3, 5))):
    with Writer(name, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/text", Text.__msgtype__, typestore=store)
        for stamp in stamps:
            writer.write(topic, stamp, store.serialize_cdr(Text("a"), Text.__msgtype__))
yaml = YAML(typ="safe")
both = yaml.load(Path("one/metadata.yaml").read_text())
info, second = both["rosbag2_bagfile_information"], yaml.load(Path("two/metadata.yaml").read_text())
shutil.copy("two/two.mcap", "one/two.mcap")
info["relative_file_paths"].append("two.mcap")
info["files"] = (info.get("files") or []) + (second["rosbag2_bagfile_information"].get("files") or [])
info["message_count"] = 6
info["topics_with_message_count"][0]["message_count"] = 6
info["duration"]["nanoseconds"] = 5
yaml.dump(both, Path("one/metadata.yaml"))
with Reader("one") as reader:
    times = [stamp for _, stamp, _ in reader.messages()]
print("times", *times)
assert times == [0, 2, 4, 1, 3, 5]
PYTHON
