"""seccomp, through libseccomp: calls that no reading of a file makes are refused with EPERM.

The library comes with Debian, whose apt depends on it. A binding from PyPI would need the same library; these six
functions of it are all that is used.
"""

from __future__ import annotations

import ctypes
import errno
import os
from typing import Final

_LIBRARY: Final = "libseccomp.so.2"
_ALLOW: Final = 0x7FFF0000
_REFUSE: Final = 0x00050000  # with the error's number in the lower half
_NE, _MASKED_EQ = 1, 7
_CLONE_THREAD: Final = 0x00010000

_REFUSED: Final = (
    # the network, and sockets of programs on this machine
    *("socket", "socketpair", "connect", "bind", "listen"),
    # other programs and processes
    *("execve", "execveat", "fork", "vfork", "kill", "tkill", "rt_sigqueueinfo", "rt_tgsigqueueinfo"),
    *("ptrace", "process_vm_readv", "process_vm_writev", "process_madvise", "kcmp", "perf_event_open"),
    *("pidfd_open", "pidfd_getfd", "pidfd_send_signal", "move_pages", "migrate_pages"),
    # memory and queues that processes share
    *("shmget", "shmat", "shmctl", "semget", "semctl", "msgget", "msgsnd", "msgrcv", "mq_open", "mq_unlink"),
    # namespaces, mounts and the kernel itself
    *("unshare", "setns", "mount", "umount2", "pivot_root", "chroot", "fsopen", "fsmount", "move_mount", "open_tree"),
    *("bpf", "userfaultfd", "io_uring_setup", "io_uring_enter", "io_uring_register", "keyctl", "add_key"),
    *("request_key", "open_by_handle_at", "name_to_handle_at", "init_module", "finit_module", "delete_module"),
    *("kexec_load", "kexec_file_load", "reboot", "swapon", "swapoff", "acct", "quotactl", "syslog", "personality"),
)


class _Argument(ctypes.Structure):
    _fields_ = (
        ("number", ctypes.c_uint),
        ("compare", ctypes.c_int),
        ("first", ctypes.c_uint64),
        ("second", ctypes.c_uint64),
    )


def refuse_calls() -> bool:
    """Refuse these calls to this process from now on; False where there is no library, or the kernel refuses."""
    try:
        library = ctypes.CDLL(_LIBRARY, use_errno=True)
    except OSError:
        return False
    library.seccomp_init.restype = ctypes.c_void_p
    context = library.seccomp_init(ctypes.c_uint32(_ALLOW))
    if not context:
        return False
    filter_ = ctypes.c_void_p(context)
    try:
        for name in _REFUSED:
            _refuse(library, filter_, name)
        # Threads are allowed, processes are not. The newer call hides its flags, so that it counts as not there.
        _refuse(library, filter_, "clone", _Argument(0, _MASKED_EQ, _CLONE_THREAD, 0))
        _refuse(library, filter_, "clone3", error=errno.ENOSYS)
        # abort() signals the process itself; limits are only for others where a number other than 0 names them.
        _refuse(library, filter_, "tgkill", _Argument(0, _NE, os.getpid(), 0))
        _refuse(library, filter_, "prlimit64", _Argument(0, _NE, 0, 0))
        return library.seccomp_load(filter_) == 0
    finally:
        library.seccomp_release(filter_)


def _refuse(
    library: ctypes.CDLL, filter_: ctypes.c_void_p, name: str, *arguments: _Argument, error: int = errno.EPERM
) -> None:
    """A rule; a call that this machine's kernel does not have needs none."""
    number: int = library.seccomp_syscall_resolve_name(name.encode())
    array = (_Argument * len(arguments))(*arguments)
    library.seccomp_rule_add_array(filter_, ctypes.c_uint32(_REFUSE | error), number, len(arguments), array)
