"""Make what tests share importable by all of them; one thread each, they run side by side."""

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # more of them only wait for each other on matrices this small
