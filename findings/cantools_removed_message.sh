#!/usr/bin/env bash
# cantools 45.1.0: a DBC with the float type of a signal of a removed message is refused, also with strict=False.
#
# Editors leave such a line (SIG_VALTYPE_) behind when a message is deleted; nothing that is read depends on it.
# cantools 40.7.1 reads the file, so that an upgrade, not the DBC, stops a driver that has run for years.
#
# Seen: 40.7.1: ['index'] with strict=True and False; 45.1.0: UnsupportedDatabaseFormatError with both
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
cat > hand.dbc <<'DBC'
VERSION ""

NS_ :

BS_:

BU_: hand

BO_ 256 index: 4 hand
 SG_ gauge_1 : 0|32@1- (1,0) [0|0] "V" hand

SIG_VALTYPE_ 256 gauge_1 : 1;
SIG_VALTYPE_ 257 gauge_1 : 1;
DBC
cat > read.py <<'PYTHON'
import sys

import cantools

for strict in (True, False):
    try:
        found = [message.name for message in cantools.database.load_file("hand.dbc", strict=strict).messages]
    except cantools.Error as error:
        found = type(error).__name__
    print(f"cantools {cantools.__version__}, strict={strict}: {found}")
    assert str(found) == sys.argv[1]
PYTHON
python3 -m venv venv
venv/bin/python -m pip install --quiet --disable-pip-version-check cantools==40.7.1 python-can==4.6.1
venv/bin/python read.py "['index']"
venv/bin/python -m pip install --quiet --disable-pip-version-check cantools==45.1.0 python-can==4.6.1
venv/bin/python read.py UnsupportedDatabaseFormatError
