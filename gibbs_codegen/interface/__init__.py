"""The emitted functions: the table of them, what its rows are made of, and sizes in a module."""

from gibbs_codegen.interface.choice import default_functions, derivatives_among, options_for
from gibbs_codegen.interface.rows import Argument, Output, Row
from gibbs_codegen.interface.signatures import (
    Signature,
    entry_labels,
    module_signatures,
    signatures,
)
from gibbs_codegen.interface.table import (
    ARGUMENTS,
    DATA,
    DATA_ON_REQUEST,
    DESCRIPTION,
    FUNCTIONS,
    LANES,
    LISTS,
    OWN_LISTS,
    WHOLES,
    derivative,
)

__all__ = [
    "ARGUMENTS",
    "DATA",
    "DATA_ON_REQUEST",
    "DESCRIPTION",
    "FUNCTIONS",
    "LANES",
    "LISTS",
    "OWN_LISTS",
    "WHOLES",
    "Argument",
    "Output",
    "Row",
    "Signature",
    "default_functions",
    "derivative",
    "derivatives_among",
    "entry_labels",
    "module_signatures",
    "options_for",
    "signatures",
]
