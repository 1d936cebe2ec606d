"""Golden values of relight-capture's partition of the sphere, from seagen.

    pip install numpy seagen==1.7
    python tools/golden_partition.py crates/relight-capture/tests/golden/partition.txt

One line a number of cells: N; cells of each ring; colatitudes of the rings' bounds; colatitudes of the cells' centres, one a ring
(radians; the caps' are 0 and pi). Azimuths are left out: seagen's offsets between rings are uninitialised memory.
"""

import sys
from pathlib import Path

import numpy as np
import seagen

CELLS = [*range(4, 61), 64, 81, 97, 100, 128, 150, 200, 250, 333, 500, 777, 1000, 1999, 3000, 5000]


def line(n):
    shell = seagen.GenShell(n, 1.0, do_stretch=False, do_rotate=False, verbosity=0)
    counts = [1, *shell.A1_N_reg_in_collar.tolist(), 1]
    bounds = shell.A1_collar_theta
    first_of_collar = np.cumsum([0, *counts[1:-2]])
    centres = [0.0, *shell.A1_theta[first_of_collar], np.pi]
    row = lambda values: " ".join(str(int(v)) if isinstance(v, int) else f"{v:.15g}" for v in values)
    return f"{n}; {row(counts)}; {row(bounds)}; {row(centres)}"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text("".join(line(n) + "\n" for n in CELLS))
