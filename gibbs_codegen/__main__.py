"""`python -m gibbs_codegen` is `gibbs-codegen`."""

import sys

from gibbs_codegen.cli.app import console

if __name__ == "__main__":
    sys.exit(console())
