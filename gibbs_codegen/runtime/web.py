"""Emitted C as WebAssembly, and the ES module that calls it: no C library, no run time of others.

The functions are those for one state. They give the bits of the same C compiled natively without
fused operations, but for arctangents, which are the browser's.
"""

from __future__ import annotations

import functools
import json
import math
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.files.templating import render
from gibbs_codegen.interface import ARGUMENTS, FUNCTIONS, LISTS, Signature, module_signatures
from gibbs_codegen.runtime.c_library import (
    NATIVE,
    RUNTIME,
    CompilerError,
    announced,
    compile_file,
    module_texts,
    some_functions,
    written,
)
from gibbs_codegen.runtime.cache import CacheError, cached_library
from gibbs_codegen.runtime.loaded_module import require_functions

TEMPLATE = "web_module.mjs.jinja"
# Without a C library, and short; what nobody calls is left out.
_FLAGS = (
    *("-std=gnu11", "-Os", "-DNDEBUG", "-fno-math-errno", "-ffp-contract=off", "-mbulk-memory"),
    *("-ffunction-sections", "-w", "-nostdlib", "-Wl,--no-entry", "-Wl,--strip-all"),
    *("-Wl,--gc-sections", "-Wl,-z,stack-size=131072", "-Wl,--export=__heap_base"),
)
# Names of clang by their versions, the newest first.
_CLANGS = ("clang", *(f"clang-{version}" for version in range(30, 10, -1)))
_MEMBER = re.compile(r"^ +\w+_real (\w+)(?:\[(\d+)\])?;", re.MULTILINE)


def web_files(
    module: ModuleType, functions: Iterable[str] | None = None, laws: Sequence[str] = ()
) -> tuple[bytes, str]:
    """Functions of a module, by default all, and laws that it has in C: WebAssembly and ES module.

    The first imports `sin`, `cos`, `atan`, `atan2` and `exp` from `env`, and exports functions as
    the header declares them, for one state, and `__heap_base`, where free memory begins. The other
    exports `load`, which takes those bytes and promises the robot: an object with a function for
    each emitted one, and an array for each argument. Raises `UsageError` where a function, a law
    or the target c is missing, or a compiler.
    """
    folder, name = Path(module.__path__[0]), module.NAME
    signatures = [x for x in module_signatures(module) if functions is None or x.name in functions]
    require_functions(module, functions or ())
    files = [RUNTIME, f"{name}.h", f"{name}.c"]
    files += [f"{name}_laws.h", f"{name}_laws.c"] if laws else []
    if laws and not (folder / files[-1]).is_file():
        raise UsageError(f"{name}: has no laws; generate it with --laws={','.join(laws)}")
    texts = module_texts(folder, files)
    headers = b"".join(texts[file] for file in files[1::2]).decode()
    chosen = [x.name for x in signatures]
    if not laws:  # They call functions that nobody names.
        parts = {part for x in chosen for part in (x, *FUNCTIONS[x].composed)}
        texts[f"{name}.c"] = some_functions(texts[f"{name}.c"], parts)
    context = script_context(module, signatures, headers, laws)
    return assembled(name, texts, [*chosen, *laws]), render(TEMPLATE, context)


def script_context(
    module: Any, signatures: Sequence[Signature], headers: str, laws: Sequence[str]
) -> dict[str, Any]:
    """Context of the template: entries of arrays by name, and parameters of functions, in order.

    `module` has the constants of a generated one, `headers` are its texts, that of laws too. A
    parameter is the name of an array that is read, or "=" and that of a number; or the name of an
    array that is written, and its entries: None where it is one of the arrays by name.
    """
    lists = {name: [*getattr(module, name, ())] for name in LISTS.values()}
    name, constants = module.NAME, re.search(r"_CONSTANTS (\d+)", headers)
    arrays: dict[str, Any] = {
        "parameters": len(lists["PARAMETERS"]),
        "constants": int(constants[1]) if constants else 0,
        "u": len(lists["INPUTS"]),
    }
    functions: dict[str, list[Any]] = {}
    for x in signatures:
        arrays |= dict(zip(x.arguments, x.widths, strict=True))
        outputs = zip(FUNCTIONS[x.name].outputs, x.shapes, strict=True)
        functions[x.name] = [
            *(name if ARGUMENTS[name].shape else f"={name}" for name in x.arguments),
            *([output.name, math.prod(shape)] for output, shape in outputs),
        ]
    structures = rf"typedef struct \{{\n(.*?)\n\}} {name}_(\w+);"
    for members, structure in re.findall(structures, headers, re.DOTALL):
        arrays[structure] = {part: int(size or 1) for part, size in _MEMBER.findall(members)}
    for law in (*laws, "init_rotors"):  # Where there are none, nothing is known of rotors.
        if found := re.search(rf"\bvoid {name}_{law}\(([^)]*)\);", headers):
            functions[law] = [*map(_parameter, found[1].split(",")[1:])]
    entries = [sum(size.values()) if isinstance(size, dict) else size for size in arrays.values()]
    results = [x[1] or 0 for y in functions.values() for x in y if isinstance(x, list)]
    return {
        "header": [],
        "lines": [],
        "name": name,
        "lists": json.dumps(lists),
        "arrays": json.dumps(arrays),
        "functions": json.dumps(functions),
        "entries": sum(entries) + sum(results),
    }


def _parameter(declared: str) -> Any:
    """A parameter of a function of laws, as C declares it."""
    first, *_, name = declared.split()
    if name[0] != "*":
        return f"={name}"
    return name[1:] if first == "const" else [name[1:], None]


def assembled(name: str, texts: Mapping[str, bytes], functions: Sequence[str]) -> bytes:
    """C files of a robot as WebAssembly that exports some functions, from the cache or made now.

    `texts` are by file names. Raises `UsageError` where no compiler makes it.
    """
    command = [*compiler(), *_FLAGS, "-I", str(NATIVE / "web"), f"-D{name.upper()}_SINGLY"]
    symbols = [*("init_constants", "default_constants", "default_parameters"), *functions]
    headers = b"".join(text for file, text in texts.items() if file.endswith(".h"))
    named = [f"{name}_{symbol}" for symbol in symbols]
    # What laws know of rotors, where there are any.
    exported = [x for x in (*named, f"{name}_init_rotors") if x.encode() in headers]

    def make(output: Path) -> None:
        what = f"{name}: compiling it to WebAssembly, to be kept for the next time"
        with written(texts, output) as files, announced(what):
            sources = map(str, files)
            exports = (f"-Wl,--export={symbol}" for symbol in exported)
            compile_file([*command, *exports, *sources, "-o", str(output)], output, command[0])

    key = "\n".join([*command, *exported, *(f"{x}\n{y.decode()}" for x, y in texts.items())])
    try:
        return cached_library(key, make).read_bytes()
    except (CompilerError, CacheError) as error:
        raise UsageError(f"{name}: no WebAssembly: {printable(error, 400)}") from None


@functools.cache
def compiler() -> tuple[str, ...]:
    """The command of a compiler that makes WebAssembly: a clang with its linker, or the extra's."""
    for clang in filter(None, map(shutil.which, _CLANGS)):
        asked = [clang, "-print-prog-name=wasm-ld"]
        done = subprocess.run(asked, capture_output=True, text=True, check=False)  # noqa: S603
        if shutil.which(done.stdout.strip()):
            return clang, "--target=wasm32", "-Wl,--allow-undefined"
    if find_spec("ziglang"):
        return sys.executable, "-m", "ziglang", "cc", "-target", "wasm32-freestanding"
    raise UsageError(
        "WebAssembly: no clang with wasm-ld, which compiles to it; install clang and lld, or the "
        "extra web: pip install 'gibbs_codegen[web]'"
    )
