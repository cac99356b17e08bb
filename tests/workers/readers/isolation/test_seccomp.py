"""A process that reads uploads makes the calls on the list, and no others."""

import json
import subprocess
import sys

import pytest

from tests.support.places import ROOT
from workers.readers.isolation.seccomp import _ALLOWED
from workers.readers.limited import isolation_here

# Allowed with some arguments alone, which are tried below.
PARTLY = {"clone", "tgkill", "prlimit64", "prctl"}
# All that a kernel has or may get: names of numbers are libseccomp's.
CALLS = """
import ctypes, errno, json, os, signal, sys
from workers.readers.isolation.seccomp import refuse_calls
libc, library = ctypes.CDLL(None, use_errno=True), ctypes.CDLL("libseccomp.so.2")
library.seccomp_syscall_resolve_num_arch.restype = ctypes.c_char_p
native = library.seccomp_arch_native()
# The kernel's own two, with which probes come back, pass all filters; elsewhere they end the process.
probes = (335, 336) if os.uname().machine == "x86_64" else ()
numbers = [number for number in range(1024) if number not in probes]
names = {number: library.seccomp_syscall_resolve_num_arch(native, number) for number in numbers}
names = {number: (name or b"number %d" % number).decode() for number, name in names.items()}
listed, tried = set(json.loads(sys.argv[1])), {}
def call(number, *arguments):
    ctypes.set_errno(0)
    answer = libc.syscall(ctypes.c_long(number), *map(ctypes.c_long, arguments))
    return errno.errorcode[ctypes.get_errno()] if answer < 0 else "done"
numbers = {name: number for number, name in names.items()}
assert refuse_calls()
signal.alarm(20)
for number, name in names.items():
    if name not in listed:
        tried[name] = call(number, 0, 0, 0, 0, 0, 0)
here = os.getpid()
tried |= {
    "fork": call(numbers["clone"], signal.SIGCHLD, 0, 0, 0, 0), "dumpable": call(numbers["prctl"], 4, 1, 0, 0, 0),
    "signal to another": call(numbers["tgkill"], os.getppid(), os.getppid(), 0),
    "limits of another": call(numbers["prlimit64"], os.getppid(), 7, 0, 0),
}
allowed = {
    "name": call(numbers["prctl"], 15, ctypes.addressof(ctypes.create_string_buffer(b"reader")), 0, 0, 0),
    "own signal": call(numbers["tgkill"], here, here, 0), "own limits": call(numbers["prlimit64"], 0, 7, 0, 0),
}
import threading
thread = threading.Thread(target=lambda: allowed.update(thread="done"))
thread.start(); thread.join()
print(json.dumps([tried, allowed]))
"""


def test_every_call_that_is_not_listed_is_not_there():
    if not isolation_here().seccomp:
        pytest.skip("no seccomp here")
    command = [sys.executable, "-c", CALLS, json.dumps(sorted({*_ALLOWED, *PARTLY}))]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    tried, allowed = json.loads(done.stdout)
    assert {name: answer for name, answer in tried.items() if answer != "ENOSYS"} == {}
    # Of these each got through, or was asked of the kernel, until the list was one of what is allowed.
    assert {"memfd_create", "socket", "execve", "fork", "ptrace", "io_uring_setup", "memfd_secret"} <= set(tried)
    assert len(tried) > 900 and set(allowed.values()) == {"done"}
