#!/usr/bin/env bash
# A column of PyTables' type for times, Time64Col or Time64Atom, takes and gives back 64-bit floating
# point numbers of seconds, as its documentation has it. On their way to the file they become whole
# seconds and whole microseconds: samples .4 us apart come back at 0, 0, 1, 1, 2, 2 us. A time that is
# not known, NaN, comes back as 0, and one shortly before zero, as of samples before a trigger, as 0 too.
# Nothing is said. NaN was asked about in https://github.com/PyTables/PyTables/issues/410, open.
# h5py reads no such column. Here: it is read as it lies in the file
# (`test_times_of_pytables_are_read_where_numpy_has_no_type_for_them`).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check \
    tables==3.11.1 numpy==2.3.5
cd "$folder"
"$folder/venv/bin/python" -W error - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import tables

print("PyTables", version("tables"))
written = np.array([0.0, 0.4e-6, 0.8e-6, 1.2e-6, 1.6e-6, 2.0e-6, np.nan, -0.2e-6])


class Row(tables.IsDescription):
    t = tables.Time64Col()
    same = tables.Float64Col()


with tables.open_file("log.h5", "w") as file:
    table = file.create_table("/", "log", Row)
    for value in written:
        table.row["t"] = table.row["same"] = value
        table.row.append()
    table.flush()
    array = file.create_earray("/", "t", tables.Time64Atom(), (0,))
    array.append(written)
with tables.open_file("log.h5") as file:
    read, same, alone = file.root.log.col("t"), file.root.log.col("same"), file.root.t[:]
print("dtype", read.dtype)
for one, back in zip(written, read, strict=True):
    print(f"written {1e6 * one:4.1f} us, read {1e6 * back:4.1f} us")

assert read.dtype == float and np.array_equal(same, written, equal_nan=True)
assert np.array_equal(alone, read)
assert np.allclose(read[:6] * 1e6, np.round(written[:6] * 1e6), atol=1e-6)
assert read[6] == 0.0 and read[7] == 0.0
PYTHON
