"""Which robot names may become a Python module and a C prefix."""

from __future__ import annotations

import itertools
import keyword
import re
import sys

from gibbs_codegen.interface import FUNCTIONS

_PATTERN = re.compile(r"[a-z][a-z0-9_]{0,63}", re.ASCII)

# Lower-case words that C99 … C23 or C++98 … C++23 reserve, Python's being asked of `keyword`.
_C_KEYWORDS = frozenset(
    [
        "alignas",
        "alignof",
        "and",
        "and_eq",
        "asm",
        "atomic_cancel",
        "atomic_commit",
        "atomic_noexcept",
        "auto",
        "bitand",
        "bitor",
        "bool",
        "break",
        "case",
        "catch",
        "char",
        "char8_t",
        "char16_t",
        "char32_t",
        "class",
        "compl",
        "concept",
        "const",
        "consteval",
        "constexpr",
        "constinit",
        "const_cast",
        "continue",
        "co_await",
        "co_return",
        "co_yield",
        "decltype",
        "default",
        "delete",
        "do",
        "double",
        "dynamic_cast",
        "else",
        "enum",
        "explicit",
        "export",
        "extern",
        "false",
        "float",
        "for",
        "fortran",
        "friend",
        "goto",
        "if",
        "inline",
        "int",
        "long",
        "mutable",
        "namespace",
        "new",
        "noexcept",
        "not",
        "not_eq",
        "nullptr",
        "operator",
        "or",
        "or_eq",
        "private",
        "protected",
        "public",
        "reflexpr",
        "register",
        "reinterpret_cast",
        "requires",
        "restrict",
        "return",
        "short",
        "signed",
        "sizeof",
        "static",
        "static_assert",
        "static_cast",
        "struct",
        "switch",
        "synchronized",
        "template",
        "this",
        "thread_local",
        "throw",
        "true",
        "try",
        "typedef",
        "typeid",
        "typename",
        "typeof",
        "typeof_unqual",
        "union",
        "unsigned",
        "using",
        "virtual",
        "void",
        "volatile",
        "wchar_t",
        "while",
        "xor",
        "xor_eq",
    ]
)

# Headers of C and POSIX, and what glibc's include, beside those named like a module of Python's: a
# module's folder is put on the include path, and its header would be read in place of them.
_C_HEADERS = frozenset(
    [
        "aio",
        "alloca",
        "complex",
        "cpio",
        "ctype",
        "dirent",
        "dlfcn",
        "endian",
        "features",
        "fenv",
        "fmtmsg",
        "ftw",
        "iconv",
        "inttypes",
        "iso646",
        "langinfo",
        "libgen",
        "limits",
        "malloc",
        "memory",
        "monetary",
        "mqueue",
        "ndbm",
        "netdb",
        "nl_types",
        "omp",
        "poll",
        "pthread",
        "regex",
        "search",
        "semaphore",
        "setjmp",
        "spawn",
        "stdalign",
        "stdarg",
        "stdatomic",
        "stdbit",
        "stdbool",
        "stdckdint",
        "stddef",
        "stdint",
        "stdio",
        "stdlib",
        "stdnoreturn",
        "strings",
        "stropts",
        "tar",
        "tgmath",
        "threads",
        "uchar",
        "ulimit",
        "unistd",
        "utime",
        "utmpx",
        "wchar",
        "wctype",
        "wordexp",
    ]
)

# A module of one of these names and the package could not be imported in one program.
_PACKAGES = frozenset(
    ["casadi", "gibbs_codegen", "jinja2", "matplotlib", "numpy", "rich", "scipy", "sympy"]
)

_WINDOWS_DEVICE = re.compile(r"con|prn|aux|nul|(com|lpt)[0-9]")

# With these a C function of one robot could have the name of another robot's, since some functions
# have names that end in those of others.
_ENDINGS = {"_casadi", "_default", "_init"} | {
    f"_{longer[: -len(shorter) - 1]}"
    for longer, shorter in itertools.permutations(FUNCTIONS, 2)
    if longer.endswith(f"_{shorter}")
}


def name_fault(name: str) -> str | None:
    """Why `name` is refused as a robot's name, or None where it is accepted."""
    shown = ascii(name if len(name) <= 64 else name[:61] + "...")
    if not _PATTERN.fullmatch(name):
        return (
            f"{shown} is not a name for a module: use a lower-case letter, then lower-case "
            "letters, digits and _, at most 64 in all"
        )
    if keyword.iskeyword(name) or keyword.issoftkeyword(name) or name in _C_KEYWORDS:
        return f"{shown} is a keyword of Python, C or C++; add a word, e.g. {name}_arm"
    if name in _PACKAGES or name in sys.stdlib_module_names:
        return f"{shown} is the name of another Python module; add a word, e.g. {name}_arm"
    if name in _C_HEADERS:
        return f"{shown}.h is a header of the C library; add a word, e.g. {name}_arm"
    if _WINDOWS_DEVICE.fullmatch(name):
        return f"{shown} can be no folder's name on Windows; add a word, e.g. {name}_arm"
    for ending in _ENDINGS:
        if name.endswith(ending):
            return (
                f"{shown} ends in {ending}, as the names of C functions go on; add a word, "
                f"e.g. {name}_arm"
            )
    return None


def name_from(text: str) -> str:
    """A name that is accepted, as close to `text` as can be."""
    letters = re.sub(r"[^a-z0-9_]+", "_", text.lower(), flags=re.ASCII).strip("_")
    if not letters[:1].isalpha():
        letters = f"robot_{letters}".rstrip("_")
    name = letters[:64]
    return name if name_fault(name) is None else f"{name[:58]}_robot"
