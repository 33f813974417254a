"""The extension that makes calls of compiled functions cheap; all else is in pyproject.toml.

It is optional: without a C compiler or Python's headers the package is installed without it. With
GIBBS_CODEGEN_PURE=1 it is left out, as it is on Windows, where the C back end does not run.
"""

import os
import sys
import sysconfig

from setuptools import Extension, setup

# Python 3.12 is the first whose stable ABI has all that the extension needs: one serves all later.
STABLE = sys.version_info >= (3, 12) and not sysconfig.get_config_var("Py_GIL_DISABLED")

left_out = sys.platform == "win32" or os.environ.get("GIBBS_CODEGEN_PURE") == "1"
extensions = []
if not left_out:
    import numpy as np  # Only the extension needs it.

    caller = Extension(
        "gibbs_codegen.runtime._caller",
        ["gibbs_codegen/runtime/native/caller.c"],
        depends=["gibbs_codegen/runtime/native/arrays.h"],
        include_dirs=[np.get_include()],
        define_macros=[("Py_LIMITED_API", "0x030C0000")] if STABLE else [],
        # Debugging information names the folder of the build.
        extra_compile_args=["-g0"],
        py_limited_api=STABLE,
        optional=True,
    )
    extensions.append(caller)

setup(
    ext_modules=extensions,
    options={"bdist_wheel": {"py_limited_api": "cp312"}} if STABLE and not left_out else {},
)
