"""`python -m gibbs_codegen` is `gibbs-codegen`."""

import sys

from gibbs_codegen.cli import main

if __name__ == "__main__":
    sys.exit(main())
