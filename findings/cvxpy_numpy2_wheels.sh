#!/usr/bin/env bash
# CVXPY 1.5.0 and 1.5.1 install beside NumPy 2, whose requirements they meet and `pip check` approves,
# and import. Their wheels are built for NumPy 1 all the same: the first problem that is solved ends in
# an ImportError of a compiled module. 1.5.2 is the first whose wheel goes with NumPy 2.
# Here: the lower bound of cvxpy is 1.5.2.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat > "$folder/problem.py" <<'PYTHON'
import cvxpy
import numpy

x = cvxpy.Variable()
problem = cvxpy.Problem(cvxpy.Minimize(cvxpy.abs(x - 1.0)), [x <= 0.5])
try:
    told = f"{problem.solve(solver='CLARABEL'):.3f}"
except ImportError as error:
    told = f"ImportError: {str(error).partition(' (')[0]}"
print(f"cvxpy {cvxpy.__version__} with numpy {numpy.__version__}: {told}")
PYTHON
for version in 1.5.1 1.5.2; do
    "${PYTHON:-python3}" -m venv "$folder/$version"
    "$folder/$version/bin/python" -m pip install --quiet --disable-pip-version-check \
        "cvxpy==$version" numpy==2.0.2 scipy==1.13.1 clarabel==0.9.0
    "$folder/$version/bin/python" -m pip check
    "$folder/$version/bin/python" "$folder/problem.py" 2> /dev/null | tee "$folder/told-$version"
done
grep -q "ImportError: cannot import name '_cvxcore'" "$folder/told-1.5.1"
grep -q "numpy 2.0.2: 0.500" "$folder/told-1.5.2"
