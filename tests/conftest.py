"""One BLAS thread per test process: the matrices are small, and the processes of a parallel run share the cores."""

import os

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
