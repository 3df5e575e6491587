#!/usr/bin/env bash
# python-can reads channel 1 of an .asc log as 0, and channel 1 of the same log as .trc as 1.
#
# A log of two buses has the numbers 1 and 2 in the file, in both formats. The readers of .asc and .blf subtract 1,
# that of .trc does not, so that `frame.channel == 1` is the second bus of one and the first bus of the other.
# The reader of candump's logs ends at the first frame with a length code above 8 (written as `_9`), without the
# frames behind it.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check python-can==4.6.1
cd "$folder"
cat > two.asc <<'LOG'
date Mon Nov 24 17:00:00.000 2025
base hex  timestamps absolute
internal events logged
Begin Triggerblock Mon Nov 24 17:00:00.000 2025
 0.000000 1  110             Rx   d 1 0A
 0.001000 2  110             Rx   d 1 0B
LOG
cat > two.trc <<'LOG'
;$FILEVERSION=2.1
;$STARTTIME=45985.7083333333
;$COLUMNS=N,O,T,B,I,d,R,L,D
      1         0.000 DT 1     0110 Rx -  1    0A
      2         1.000 DT 2     0110 Rx -  1    0B
LOG
cat > raw.log <<'LOG'
(1764000000.000000) can0 110#0011223344556677
(1764000000.001000) can0 111#0011223344556677_9
(1764000000.002000) can0 110#0011223344556677
LOG
venv/bin/python - > found <<'PYTHON'
import can

print("python-can", can.__version__)
for name in ("two.asc", "two.trc"):
    print(name, [(frame.channel, frame.data.hex()) for frame in can.LogReader(name)])
frames = []
try:
    for frame in can.LogReader("raw.log"):
        frames.append(frame)
except ValueError as error:
    print("raw.log", "ValueError:", error)
print("raw.log", len(frames), "of 3 frames")
PYTHON
cat found
diff found - <<'EXPECTED'
python-can 4.6.1
two.asc [(0, '0a'), (1, '0b')]
two.trc [(1, '0a'), (2, '0b')]
raw.log ValueError: invalid literal for int() with base 16: '_9'
raw.log 1 of 3 frames
EXPECTED
