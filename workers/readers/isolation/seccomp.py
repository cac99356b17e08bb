"""seccomp, through libseccomp: a process that reads files makes the calls listed here, and no others.

Any other call, also one that a later kernel adds, fails with ENOSYS: libraries then try an older one, or do without.
The list is what all readers call, as seen on x86-64 with glibc 2.36 while their tests ran, and what other versions of
glibc, or arm64, have in the place of these. The library comes with Debian, whose apt depends on it. A binding from
PyPI would need the same library; these six functions of it are all that is used.
"""

from __future__ import annotations

import ctypes
import errno
import os
from typing import Final

_LIBRARY: Final = "libseccomp.so.2"
_ALLOW: Final = 0x7FFF0000
_REFUSE: Final = 0x00050000  # with the error's number in the lower half
_EQ, _MASKED_EQ = 4, 7
_CLONE_THREAD: Final = 0x00010000
_PR_SET_NAME, _PR_GET_NAME = 15, 16

_ALLOWED: Final = (
    # memory, but for what no limit of the process counts (memfd_create)
    *("brk", "mmap", "munmap", "mprotect", "mremap", "madvise", "membarrier"),
    # files: what may be opened is Landlock's
    *("open", "openat", "close", "close_range", "read", "readv", "pread64", "preadv", "write", "writev", "pwrite64"),
    *("pwritev", "lseek", "fadvise64", "readahead", "sendfile", "copy_file_range", "ftruncate", "truncate"),
    *("fallocate", "fsync", "fdatasync", "flock", "fcntl", "dup", "dup2", "dup3", "pipe", "pipe2", "ioctl"),
    *("stat", "fstat", "lstat", "newfstatat", "fstatat64", "statx", "statfs", "fstatfs", "access", "faccessat"),
    *("faccessat2", "getdents", "getdents64", "readlink", "readlinkat", "getcwd", "chdir", "umask"),
    *("mkdir", "mkdirat", "rmdir", "unlink", "unlinkat", "rename", "renameat", "renameat2", "utimensat"),
    *("chmod", "fchmod", "fchmodat"),
    # threads, and the process itself
    *("futex", "futex_waitv", "set_robust_list", "get_robust_list", "rseq", "set_tid_address", "arch_prctl"),
    *("sched_yield", "sched_getaffinity", "sched_setaffinity", "sched_getparam", "sched_getscheduler", "getcpu"),
    *("getpid", "getppid", "gettid", "getuid", "geteuid", "getgid", "getegid", "getresuid", "getresgid", "getpgrp"),
    *("exit", "exit_group", "rt_sigaction", "rt_sigprocmask", "rt_sigreturn", "rt_sigtimedwait", "sigaltstack"),
    *("restart_syscall", "getrlimit", "getrusage", "times", "sysinfo", "uname", "getrandom"),
    # time, and waiting
    *("clock_gettime", "clock_getres", "clock_nanosleep", "nanosleep", "gettimeofday", "time", "poll", "ppoll"),
    *("select", "pselect6", "epoll_create1", "epoll_ctl", "epoll_wait", "epoll_pwait", "eventfd2"),
)


class _Argument(ctypes.Structure):
    _fields_ = (
        ("number", ctypes.c_uint),
        ("compare", ctypes.c_int),
        ("first", ctypes.c_uint64),
        ("second", ctypes.c_uint64),
    )


def refuse_calls() -> bool:
    """Refuse all other calls to this process from now on; False where there is no library, or the kernel refuses."""
    try:
        library = ctypes.CDLL(_LIBRARY, use_errno=True)
    except OSError:
        return False
    library.seccomp_init.restype = ctypes.c_void_p
    context = library.seccomp_init(ctypes.c_uint32(_REFUSE | errno.ENOSYS))
    if not context:
        return False
    filter_ = ctypes.c_void_p(context)
    try:
        for name in _ALLOWED:
            _allow(library, filter_, name)
        # Threads, no processes. The newer clone3 hides its flags: it is not there, and glibc takes this one.
        _allow(library, filter_, "clone", _Argument(0, _MASKED_EQ, _CLONE_THREAD, _CLONE_THREAD))
        # abort() signals the process itself; 0 names it where limits are asked for.
        _allow(library, filter_, "tgkill", _Argument(0, _EQ, os.getpid(), 0))
        _allow(library, filter_, "prlimit64", _Argument(0, _EQ, 0, 0))
        for option in (_PR_SET_NAME, _PR_GET_NAME):
            _allow(library, filter_, "prctl", _Argument(0, _EQ, option, 0))
        return library.seccomp_load(filter_) == 0
    finally:
        library.seccomp_release(filter_)


def _allow(library: ctypes.CDLL, filter_: ctypes.c_void_p, name: str, *arguments: _Argument) -> None:
    """A rule; a call that this machine's kernel does not have needs none."""
    number: int = library.seccomp_syscall_resolve_name(name.encode())
    array = (_Argument * len(arguments))(*arguments)
    library.seccomp_rule_add_array(filter_, ctypes.c_uint32(_ALLOW), number, len(arguments), array)
