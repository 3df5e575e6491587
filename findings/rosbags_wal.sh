#!/usr/bin/env bash
# rosbags 0.11.9: what is in the write-ahead log beside a .db3 is not read, without a warning.
#
# rosbags opens SQLite with immutable=1, which tells SQLite that nothing else belongs to the file. A recorder
# that was killed leaves its last messages in bag.db3-wal; any other SQLite client, rosbag2 too, reads them.
#
# Seen: sqlite3 10 messages, rosbags 5
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv venv
venv/bin/python -m pip install --quiet --disable-pip-version-check rosbags==0.11.9
venv/bin/python - <<'PYTHON'
import shutil
import sqlite3
from pathlib import Path

from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
Text = store.types["std_msgs/msg/String"]
with Writer("bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
    topic = writer.add_connection("/text", Text.__msgtype__, typestore=store)
    for stamp in range(5):
        writer.write(topic, stamp, store.serialize_cdr(Text("a"), Text.__msgtype__))
database = sqlite3.connect("bag/bag.db3", isolation_level=None)
database.execute("PRAGMA journal_mode=WAL")
for stamp in range(5, 10):
    row = 1, stamp, bytes(store.serialize_cdr(Text("b"), Text.__msgtype__))
    database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", row)
shutil.copytree("bag", "killed")  # as a recorder leaves it that has no time to close its database
with Reader("killed") as reader:
    by_rosbags = len(list(reader.messages()))
(by_sqlite,) = sqlite3.connect("killed/bag.db3").execute("SELECT count(*) FROM messages").fetchone()
print(f"sqlite3 {by_sqlite} messages, rosbags {by_rosbags}")
assert (by_sqlite, by_rosbags) == (10, 5)
PYTHON
