"""Time pages on which robots fly, in headless Chromium: `python benchmarks/page_times.py`.

A line for each robot that ships, or for those named: seconds of a processor and by the clock until
the page is written, bytes of WebAssembly and of the page, milliseconds until the browser paints it,
and in its second second frames, and microseconds that a millisecond of flight takes. It needs the
extra `ci`, Chromium, and a machine that does nothing else.
"""

from __future__ import annotations

import base64
import gzip
import os
import re
import sys
import tempfile
import time
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1] / "tests")]

from support.browser import visit  # noqa: E402

from gibbs_codegen import fly_html  # noqa: E402
from gibbs_codegen.errors import UsageError  # noqa: E402
from gibbs_codegen.robot.file import shipped_robots  # noqa: E402

PAINT = "performance.getEntriesByName('first-contentful-paint')[0].startTime"


def processor_time() -> float:
    """Seconds of this process and of the compilers that it called."""
    return sum(os.times()[:4])


def main() -> None:
    columns = ("robot", "cpu s", "clock s", "wasm kB", "page kB", "paint ms", "frames", "µs a ms")
    print("{:22}{:>7}{:>9}{:>9}{:>9}{:>10}{:>8}{:>9}".format(*columns))
    for name in sys.argv[1:] or shipped_robots():
        cpu, clock = processor_time(), time.perf_counter()
        try:
            page = fly_html(name)
        except UsageError as error:
            print(error)
            continue
        built = processor_time() - cpu, time.perf_counter() - clock
        packed = re.search(r'atob\("([^"]*)"\)', page.text)
        assembly = gzip.decompress(base64.b64decode(packed[1] if packed else ""))
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder, "page.html")
            page.save(place)
            with visit(place.as_uri()) as seen:
                seen.page.wait_for_function("globalThis.flight?.stats().flown > 1000")
                before = seen.page.evaluate("flight.stats()")
                seen.page.wait_for_timeout(1000)
                after = seen.page.evaluate("flight.stats()")
                paint = seen.page.evaluate(PAINT)
        flown, frames, cost = (after[x] - before[x] for x in ("flown", "frames", "cost"))
        sizes = len(assembly) / 1e3, page.size / 1e3
        print(f"{name:22}{built[0]:7.1f}{built[1]:9.1f}{sizes[0]:9.1f}{sizes[1]:9.1f}", end="")
        print(f"{paint:10.0f}{1e3 * frames / flown:8.0f}{1e3 * cost / flown:9.1f}", flush=True)


if __name__ == "__main__":
    main()
