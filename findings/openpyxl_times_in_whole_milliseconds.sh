#!/usr/bin/env bash
# A time in an .xlsx file is a number of days, which tells the instants of today to a microsecond.
# openpyxl, and pandas through it, round cells with the format of a date or of a time of day to whole
# milliseconds on the way in: samples .4 ms apart come back at 0, 0, 1, 1, 2, 2 ms, and those 1.4 ms
# apart with steps of 1 and 2 ms. The file is right, its writer is openpyxl itself.
# Here: docs/formats.md says so; a clock of which most rows repeat their time is refused.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check \
    openpyxl==3.1.5 pandas==2.3.3 numpy==2.3.5
cd "$folder"
"$folder/venv/bin/python" -W error - <<'PYTHON'
import re
from datetime import datetime, timedelta
from importlib.metadata import version
from zipfile import ZipFile

import numpy as np
import openpyxl
import pandas as pd

print("openpyxl", version("openpyxl"), "pandas", version("pandas"))
DAY, MORNING = datetime(2026, 11, 29), timedelta(hours=10)


def steps(microseconds):
    """Steps in ms of a recording: as they lie in the file, as dates and times of day are read."""
    book = openpyxl.Workbook()
    for k in range(7):
        moment = DAY + MORNING + k * timedelta(microseconds=microseconds)
        book.active.append([moment, moment.time()])
        for cell, shown in zip(book.active[k + 1], ("yyyy-mm-dd hh:mm:ss.000", "hh:mm:ss.000")):
            cell.number_format = shown
    book.save("log.xlsx")
    sheet = ZipFile("log.xlsx").read("xl/worksheets/sheet1.xml").decode()
    days = [float(one) for one in re.findall(r'<c r="A\d+"[^>]*><v>([^<]*)</v>', sheet)]
    dates, times = pd.read_excel("log.xlsx", header=None).to_numpy().T
    seconds = [(datetime.combine(DAY, one) - DAY).total_seconds() for one in times]
    return (
        1e3 * 86400 * np.diff(days),
        1e3 * np.array([one.total_seconds() for one in np.diff(dates)]),
        1e3 * np.diff(seconds),
    )


for wanted in (0.4, 1.4):
    stored, dates, times = steps(round(1e3 * wanted))
    print(f"{wanted} ms apart: in the file", stored.round(3), "dates", dates, "times of day", times)
    assert np.allclose(stored, wanted, atol=2e-3)
    for read in (dates, times):
        assert np.allclose(read, np.round(read), atol=1e-6) and np.ptp(read) > 0.9
PYTHON
