#!/usr/bin/env bash
# mcap 1.6.0: with log_time_order=False the first message costs as much memory as all chunks.
#
# "In the order of the file" sounds like the cheap way to stream. iter_messages(log_time_order=False) puts all
# chunks into its queue first, and unpacks them there; in the order of times it unpacks one after the other.
#
# Seen: to the first message of 32 MB in 32 chunks: in order of times 2 MB, in order of the file 33 MB
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv venv
venv/bin/python -m pip install --quiet --disable-pip-version-check mcap==1.6.0
venv/bin/python - <<'PYTHON'
import tracemalloc

from mcap.reader import make_reader
from mcap.writer import Writer

with open("large.mcap", "wb") as file:
    writer = Writer(file, chunk_size=1_000_000)
    writer.start()
    channel = writer.register_channel("/image", "json", writer.register_schema("s", "jsonschema", b"{}"))
    for stamp in range(320):
        writer.add_message(channel, log_time=stamp, publish_time=stamp, data=bytes(100_000))
    writer.finish()
peak = {}
for ordered in (True, False):
    with open("large.mcap", "rb") as file:
        tracemalloc.start()
        next(iter(make_reader(file).iter_messages(log_time_order=ordered)))
        peak[ordered] = tracemalloc.get_traced_memory()[1] / 1e6
        tracemalloc.stop()
print(f"to the first message: in order of times {peak[True]:.0f} MB, in order of the file {peak[False]:.0f} MB")
assert peak[True] < 6 and peak[False] > 25, peak
PYTHON
