"""What tests share: random robots, oracles, emitted modules, programs that are run.

What Python compiles is kept from here on, also where it is told to keep nothing: else each of many
processes would compile the package once more.
"""

import os
import sys

os.environ["PYTHONDONTWRITEBYTECODE"] = ""
sys.dont_write_bytecode = False
# Arrays are small, and the other processors have tests of their own to run.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
