"""The emitted functions: the table of them, what its rows are made of, and sizes in a module."""

from gibbs_codegen.interface.rows import Argument, Output, Row
from gibbs_codegen.interface.signatures import Signature, module_signatures, signatures
from gibbs_codegen.interface.table import (
    ARGUMENTS,
    DATA,
    DATA_ON_REQUEST,
    FUNCTIONS,
    LANES,
    LISTS,
    derivative,
)

__all__ = [
    "ARGUMENTS",
    "DATA",
    "DATA_ON_REQUEST",
    "FUNCTIONS",
    "LANES",
    "LISTS",
    "Argument",
    "Output",
    "Row",
    "Signature",
    "derivative",
    "module_signatures",
    "signatures",
]
