"""Make what tests share importable by all of them."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
