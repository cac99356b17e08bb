"""What a reading process could do if an upload took it over: tries it, and prints what it got.

``refused`` names calls that the kernel refuses from the beginning,
as a container's runtime may.
"""

import contextlib
import ctypes
import errno
import json
import os
import socket
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

from workers.readers.isolation.isolate import isolate
from workers.readers.isolation.seccomp import _REFUSE

_ALLOW = 0x7FFF0000


def refuse(names):
    """As the runtime of a container does, before anything of ours runs."""
    library = ctypes.CDLL("libseccomp.so.2")
    library.seccomp_init.restype = ctypes.c_void_p
    filter_ = ctypes.c_void_p(library.seccomp_init(ctypes.c_uint32(_ALLOW)))
    for name in names:
        number = library.seccomp_syscall_resolve_name(name.encode())
        library.seccomp_rule_add_array(filter_, ctypes.c_uint32(_REFUSE | errno.EPERM), number, 0, None)
    assert library.seccomp_load(filter_) == 0


def attempt(what):
    """What came of it: a result, or the error's name."""
    try:
        return what() or "done"
    except OSError as error:
        return errno.errorcode[error.errno]
    except subprocess.SubprocessError as error:
        return str(error)


def connect(family, address):
    with contextlib.closing(socket.socket(family, socket.SOCK_STREAM)) as client:
        client.settimeout(2)
        client.connect(address)


def attach(pid):
    """PTRACE_ATTACH."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.ptrace(16, pid, None, None) != 0:
        raise OSError(ctypes.get_errno(), "ptrace")


def main():
    case = json.loads(sys.argv[1])
    if case["refused"]:
        refuse(case["refused"])
    parent, out = case["parent"], Path(case["out"])
    isolation = isolate([Path(case["source"])], [out])
    results = {
        "environ": lambda: len(Path(f"/proc/{parent}/environ").read_bytes()),
        "memory": lambda: os.close(os.open(f"/proc/{parent}/mem", os.O_RDONLY)),
        "ptrace": lambda: attach(parent),
        "signal": lambda: os.kill(parent, 0),
        "tcp": lambda: connect(socket.AF_INET, ("127.0.0.1", case["port"])),
        "broker": lambda: connect(socket.AF_UNIX, case["broker"]),
        "database": lambda: len(Path(case["database"]).read_bytes()),
        "outside": lambda: Path(case["database"]).with_name("written").write_text("x"),
        "source written": lambda: Path(case["source"]).write_text("x"),
        "program": lambda: subprocess.run(["/bin/true"], check=True),
        "process": lambda: os._exit(0) if os.fork() == 0 else None,
        "root": lambda: [str(path) for path in Path("/root").iterdir()],
        "source read": lambda: len(Path(case["source"]).read_bytes()),
        "own folder": lambda: (out / "x").write_text("x"),
        "python": lambda: len(Path(json.__file__).read_bytes()),
    }
    print(json.dumps({"isolation": asdict(isolation)} | {name: attempt(what) for name, what in results.items()}))


main()
