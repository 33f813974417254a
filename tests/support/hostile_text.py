"""Names and other text that would do harm where they were executed, rendered or shown as they are.

What runs code makes a file called `canary` in the working directory.
"""

from __future__ import annotations

import keyword
import re
import sys

_TOUCH = "__import__('pathlib').Path('canary').touch()"

INJECTIONS = [
    *(
        _TOUCH,
        f"a;{_TOUCH}",
        f"a\n{_TOUCH}\n",
        f"lambda:{_TOUCH}",
        f"[{_TOUCH}]",
        f"f'{{{_TOUCH}}}'",
    ),
    *(f"{{{{ {_TOUCH} }}}}", f"{{% set x = {_TOUCH} %}}", f"{{# {_TOUCH} #}}", "{{7*7}}", "${7*7}"),
    *("{{ cycler.__init__.__globals__.os.system('touch canary') }}", "{% include '/etc/passwd' %}"),
    *(
        f'"""\n{_TOUCH}\n"""',
        f"'''\n{_TOUCH}\n'''",
        f'"; {_TOUCH} #',
        f"'; {_TOUCH} #",
        f"\\\n{_TOUCH}",
    ),
    *(
        "().__class__.__base__.__subclasses__()",
        "os.system('touch canary')",
        "exec('1')",
        "eval(1)",
    ),
    *("$(touch canary)", "`touch canary`", "; touch canary", "| touch canary", "&& touch canary"),
    *("> canary", "\ntouch canary\n", "$HOME", "~", "*", "?", "!!", "%COMSPEC%", "-rf", "--help"),
    *(
        "*/ int evil(void); /*",
        "*/",
        "/*",
        "//",
        "??/",
        "\\",
        '"',
        "'",
        "#include <stdlib.h>",
        "a;b",
    ),
    *("a\n#define double float", "a) __attribute__((constructor)) void f(void", "<script>", "a,b"),
    *("%s%s%s%n", "%(x)s", "{0}", "{}", "{0.__class__}", "{x!r:>9999}", "%99999999d", "$x", "a=b"),
    *(
        "\\input{canary}",
        "\\write18{touch canary}",
        "$\\frac{$",
        "$$",
        "_^",
        "\\",
        "\\u0041",
        "\\x41",
    ),
    *(
        "[red]a[/red]",
        "[/]",
        "[link=https://example.org]a[/link]",
        "[bold",
        ":smile:",
        "[@click=a()]",
    ),
    *("../evil", "..", ".", "a/b", "a\\b", "/etc/passwd", "C:\\evil", "file:///etc/passwd", "a.b"),
    *("' OR 1=1 --", "!!python/object/apply:os.system ['touch canary']", "=1+1", "@a", "a b", " a"),
    *(
        "",
        "_",
        "__",
        "__init__",
        "__import__",
        "_arm",
        "9",
        "9arm",
        "arm-1",
        "-arm",
        "arm ",
        "NaN",
        "1e5",
    ),
    *("a" * 65, "a" * 255, "a" * 5000, "arm" * 22, "_" * 64, "9" * 64),
]
TERMINAL = [
    *("\x1b[31mred", "\x1b[2J", "\x1b]0;title\x07", "\x1b]8;;https://example.org\x1b\\a", "\x1bc"),
    *(
        "\x9b31m",
        "a\x08\x08b",
        "a\rb",
        "a\nb: refused",
        "a\x0bb",
        "a\x0cb",
        "\x07",
        "a\tb",
        "a\x7f",
    ),
    *(
        "\u202eevil",
        "\u2066a\u2069",
        "a\u200bb",
        "a\u00adb",
        "a\ufeff",
        "a\u2028b",
        "a\u2029b",
        "a\u0085b",
    ),
    *("\u00a0", "a\u3000b", "\ufdd0", "\U000e0041", "\U0010ffff", "\ufff9a"),
]
CONTROLS = [f"arm{chr(code)}" for code in (*range(1, 0x20), *range(0x7F, 0xA0))]

# One letter of "aerobot_x" replaced by one that looks like it, or folds to it.
LOOK_ALIKES = [
    "aerobot_x".replace(letter, twin)
    for letter, twins in {
        "a": "аɑα\uff41ａàᵃ",
        "e": "еҽ\uff45ₑé",
        "r": "гᴦ\uff52ʳ",
        "o": "оο०\uff4fº",
        "b": "Ьｂ",
        "t": "тｔᵗ",
        "_": "＿‿⁔‐–",
        "x": "хχ×ｘˣ",
    }.items()
    for twin in twins
] + ["ﬁeld", "ﬂyer", "ĳ", "ﬆep", "Ⅷ", "ⅷ", "aerobot²", "aerobot₂", "ß", "ı", "İ", "K"]

DEVICES = ["con", "prn", "aux", "nul", *(f"{d}{i}" for d in ("com", "lpt") for i in range(10))]
PLAIN = ["arm", "aerobot_x", "my_uav", "hexarotor", "q", "con", "class"]
CASE_TWINS = [twin for name in PLAIN for twin in (name.upper(), name.title(), f"{name}X")]

NAMES = list(
    dict.fromkeys(
        [
            *INJECTIONS,
            *TERMINAL,
            *CONTROLS,
            *LOOK_ALIKES,
            *DEVICES,
            *CASE_TWINS,
            "numpy",
            *keyword.kwlist,
        ]
    )
)

# Lower-case words that C and C++ reserve.
C_WORDS = re.findall(
    r"\w+",
    "alignas alignof and and_eq asm auto bitand bitor bool break case catch char char8_t "
    "char16_t char32_t class compl concept const consteval constexpr constinit const_cast "
    "continue co_await co_return co_yield decltype default delete do double dynamic_cast else "
    "enum explicit export extern false float for friend goto if inline int long mutable "
    "namespace new noexcept not not_eq nullptr operator or or_eq private protected public "
    "register reinterpret_cast requires restrict return short signed sizeof static "
    "static_assert static_cast struct switch template this thread_local throw true try "
    "typedef typeid typename typeof typeof_unqual union unsigned using virtual void volatile "
    "wchar_t while xor xor_eq",
)
C_HEADERS = re.findall(
    r"\w+",
    "assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal "
    "stdalign stdarg stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string tgmath "
    "threads time uchar wchar wctype features strings unistd pthread",
)
# What is accepted though it means something elsewhere.
FAMILIAR = sorted({*C_WORDS, *C_HEADERS, *keyword.softkwlist, *sys.stdlib_module_names})
FAMILIAR = [name for name in FAMILIAR if name[0] != "_" and name.islower() and name not in NAMES]
