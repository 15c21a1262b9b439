"""What every test process needs.

One BLAS thread each: the matrices are small, and the processes of a parallel run share the cores. Bytecode is kept,
whatever the user keeps: the many runs of the program as a process of its own would each compile it anew.
"""

import os
import sys

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
