"""Where programs that are not Python find this one.

An FMU's Linux binary runs the text of this file in the python that it found, with whatever packages that has: so it imports nothing but
the standard library.
"""

from __future__ import annotations

import os
import sys
import sysconfig
from importlib.metadata import PackageNotFoundError, version


def shared_library() -> str | None:
    """Path of this Python's shared library, or None if it has none beside its executable or in the system's folders."""
    name = f"libpython{sysconfig.get_config_var('LDVERSION')}.so.1.0"
    folder = sysconfig.get_config_var("LIBDIR") or ""
    # Debian has a folder for each architecture; a Python that was moved after it was built names the folder where it no longer is.
    folders = (folder, os.path.join(folder, sysconfig.get_config_var("MULTIARCH") or ""), os.path.join(sys.base_prefix, "lib"))
    paths = (os.path.join(folder, name) for folder in folders)
    return next((path for path in paths if os.path.exists(path)), None)


def main() -> None:
    """Write one line: Python's version, executable and library, and the version of the package; empty for what is not there."""
    sys.path[:] = [path for path in sys.path if path]  # without the working directory, which the FMU's Python does not search
    try:
        package = version("cdl-fmu")
    except PackageNotFoundError:
        package = ""
    fields = ("cdl-fmu", f"{sys.version_info[0]}.{sys.version_info[1]}", sys.executable, shared_library() or "", package)
    os.write(1, os.fsencode("\t".join(fields) + "\n"))


if __name__ == "__main__":
    main()
