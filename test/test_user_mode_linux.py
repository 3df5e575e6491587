"""The library that lets user-mode Linux restore registers on any CPU."""

import ctypes
import errno
import os
import platform
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).parent / "socketcan" / "whole_xsave.c"

PTRACE_ATTACH, PTRACE_GETREGSET, PTRACE_SETREGSET = 16, 0x4204, 0x4205
NT_X86_XSTATE = 0x202
PART = 576
"""Registers of SSE and the header of the XSAVE area, bytes; the area of a CPU with AVX is longer."""

XMM15 = slice(160 + 15 * 16, 160 + 16 * 16)
FEATURES_IN_USE = 512
"""Place of the bits that tell the CPU which registers to load; bit 1 is SSE."""


class IoVector(ctypes.Structure):
    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


def transfer(library: ctypes.CDLL, request: int, pid: int, data: ctypes.Array) -> int:
    """Read or write registers of a stopped process; returns the number of an error, or 0."""
    vector = IoVector(ctypes.addressof(data), len(data))
    failed = library.ptrace(request, pid, ctypes.c_void_p(NT_X86_XSTATE), ctypes.byref(vector))
    return ctypes.get_errno() if failed else 0


@pytest.fixture
def stopped() -> Iterator[int]:
    with subprocess.Popen(["sleep", "60"]) as process:
        if ctypes.CDLL(None).ptrace(PTRACE_ATTACH, process.pid, None, None):
            pytest.skip("this process may not trace its children")
        os.waitpid(process.pid, 0)
        yield process.pid
        process.send_signal(signal.SIGKILL)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="XSAVE is of x86")
@pytest.mark.skipif(not shutil.which("cc"), reason="needs a C compiler")
def test_part_of_the_registers_is_restored_and_the_others_are_kept(stopped: int, tmp_path: Path) -> None:
    binary = tmp_path / "whole_xsave.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-Wall", "-Werror", "-o", binary, SOURCE, "-ldl"], check=True)
    host, library = (ctypes.CDLL(name, use_errno=True) for name in (None, str(binary)))
    whole, part = ctypes.create_string_buffer(1 << 14), ctypes.create_string_buffer(PART)
    assert transfer(host, PTRACE_GETREGSET, stopped, whole) == 0
    assert transfer(host, PTRACE_GETREGSET, stopped, part) == 0
    registers = bytearray(part.raw)
    registers[XMM15] = bytes(range(16))
    registers[FEATURES_IN_USE] |= 2
    part.raw = bytes(registers)
    assert transfer(host, PTRACE_SETREGSET, stopped, part) == errno.EFAULT, "the host takes the whole"
    assert transfer(library, PTRACE_SETREGSET, stopped, part) == 0
    found = ctypes.create_string_buffer(1 << 14)
    assert transfer(host, PTRACE_GETREGSET, stopped, found) == 0
    assert found.raw[XMM15] == bytes(range(16))
    assert found.raw[PART:] == whole.raw[PART:]
