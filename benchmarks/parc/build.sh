#!/bin/sh
# Build an environment of its own for PARC, whose dependencies clash with ours:
#
#     benchmarks/parc/build.sh [FOLDER]        # FOLDER: build/parc by default
#     python -m benchmarks.quality --parc FOLDER/bin/python
#
# pycddlib is compiled from source and needs the headers of gmp (libgmp-dev, gmp-devel).
set -eu
here=$(dirname "$0")
folder=${1:-build/parc}
python=${PYTHON:-python3}
"$python" -m venv "$folder"
"$folder/bin/pip" install --quiet -r "$here/requirements.txt"
"$folder/bin/pip" install --quiet --no-deps pyparc==2.0.4
"$folder/bin/python" -c "from pyparc.parc import PARC"
echo "$folder/bin/python"
