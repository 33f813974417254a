"""A program in a Python that lacks what Windows lacks: `python without_posix.py ARGUMENTS…`.

The arguments are those of `gibbs-codegen`. Modules and functions that only POSIX systems have are
gone, as are compilers and /proc; folders cannot be opened, nothing is renamed to a name that is
taken, and the package may open no text without saying how it is encoded. What the standard library
and NumPy stand on here (`posix`, waiting for processes, `os.uname`) stays.
"""

from __future__ import annotations

import os
import signal
import sys
import warnings
from typing import Any, NoReturn

MODULES = "crypt fcntl grp nis ossaudiodev pty pwd readline resource spwd syslog termios tty"
OF_OS = """
    O_CLOEXEC O_DIRECTORY O_NOFOLLOW O_NONBLOCK chown fchdir fchmod fchown fork forkpty getegid
    geteuid getgid getgroups getloadavg getpgid getpgrp getpriority getsid getuid killpg lchown
    lockf mkfifo mknod nice posix_fallocate pread pwrite sched_getaffinity sched_setaffinity
    sched_yield setpgid setsid statvfs sync sysconf
"""
OF_SIGNAL = "SIGALRM SIGCHLD SIGHUP SIGKILL SIGUSR1 alarm pthread_sigmask setitimer"

opens, renames = os.open, os.rename


def opened(path: Any, *rest: Any, **named: Any) -> int:
    """`os.open` as on Windows, where a folder cannot be opened."""
    if os.path.isdir(path):
        raise PermissionError(13, "Permission denied", path)
    return opens(path, *rest, **named)


def renamed(old: Any, new: Any, **named: Any) -> None:
    """`os.rename` as on Windows, where it replaces nothing."""
    if os.path.lexists(new):
        raise FileExistsError(183, "exists already", old, None, new)
    renames(old, new, **named)


def replaced(old: Any, new: Any) -> None:
    """`os.replace` as on Windows, where it replaces files, and folders not even if empty."""
    if os.path.isdir(new):
        raise PermissionError(13, "Access is denied", old, None, new)
    (os.unlink if os.path.lexists(new) else id)(new)
    renames(old, new)


def no_proc(event: str, arguments: tuple[Any, ...]) -> None:
    """An audit hook that hides /proc."""
    if event == "open" and str(arguments[0]).startswith("/proc"):
        raise FileNotFoundError(2, "No such file or directory", arguments[0])


def hide() -> None:
    """Take away what Windows lacks, before anything of the package is imported."""
    for name in MODULES.split():
        sys.modules[name] = None  # type: ignore[assignment]
    for module, names in ((os, OF_OS), (signal, OF_SIGNAL)):
        for name in names.split():
            if hasattr(module, name):
                delattr(module, name)
    os.open, os.rename, os.replace = opened, renamed, replaced  # type: ignore[assignment]
    os.environ["PATH"] = ""
    os.environ.pop("CC", None)
    sys.addaudithook(no_proc)
    warnings.filterwarnings("error", category=EncodingWarning, module="gibbs_codegen")


def main() -> NoReturn:
    """Hide, and run the command line."""
    hide()
    from gibbs_codegen.cli.app import console

    sys.exit(console())


if __name__ == "__main__":
    main()
