"""Compiled loops as AArch64 processors run them, emulated instruction by instruction."""

import ctypes
import math
import re
import struct
from collections.abc import Callable, Iterator
from typing import Any

import llvmlite.binding as llvm
import numba
import numpy as np
import unicorn
from numpy.typing import NDArray
from unicorn import arm64_const as arm

_unicorn: Any = unicorn
_TRIPLE = "aarch64-unknown-linux-gnu"
_PAGE, _STACK, _STACK_BYTES, _OUTSIDE, _STRIDE = 0x1000, 0x20000000, 0x400000, 0x10000000, 64
_RETURN = bytes.fromhex("c0035fd6")
_INTEGERS = [arm.UC_ARM64_REG_X0 + i for i in range(8)]
_FLOATS = [arm.UC_ARM64_REG_D0 + i for i in range(8)]
_DECREASED = """
define i8 @arm_decreased(ptr %count, i64 %by, i32 %condition) {
  %old = load i64, ptr %count
  %new = sub i64 %old, %by
  store i64 %new, ptr %count
  %none = icmp eq i64 %new, 0
  %told = zext i1 %none to i8
  ret i8 %told
}
"""


class EmulatedArm:
    """A compiled function on an emulated AArch64 processor.

    It works on the arrays of this process. Functions from outside (memory, exp2, log) are those of Python.

    Args:
        function: Decorated with `models.compiled.compiled`.
        arguments: Examples of its arguments, for their types.
    """

    def __init__(self, function: Any, arguments: tuple[Any, ...]) -> None:
        dispatcher: Any = numba.jit(**function.targetoptions)(function.py_func)
        types = tuple(numba.typeof(each) for each in arguments)
        dispatcher.compile(types)
        overload = dispatcher.overloads[types]._asdict()
        self._held: list[NDArray[np.uint8]] = []
        self._names, self._begin = self._loaded(overload["library"].get_llvm_str(), overload["fndesc"].llvm_func_name)
        self._processor = _unicorn.Uc(unicorn.UC_ARCH_ARM64, unicorn.UC_MODE_ARM)
        self._processor.mem_map(_OUTSIDE, 0x10000)
        self._processor.mem_write(_OUTSIDE, _RETURN * (0x10000 // len(_RETURN)))
        self._processor.mem_map(_STACK, _STACK_BYTES)
        self._processor.hook_add(unicorn.UC_HOOK_MEM_UNMAPPED, self._share)
        self._processor.hook_add(unicorn.UC_HOOK_CODE, self._outside, begin=_OUTSIDE, end=_OUTSIDE + 0xEFFF)

    def _loaded(self, text: str, name: str) -> tuple[list[str], int]:
        """Names of functions from outside, and the address of the machine code."""
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
        text = re.sub(r"(?m)^target datalayout = .*$", "", text)
        text = re.sub(r"(?m)^target triple = .*$", f'target triple = "{_TRIPLE}"', text)
        text = re.sub(r"(?m)^declare i8 @llvm\.x86\.atomic\.sub.*$", "", text)
        text = text.replace("@llvm.x86.atomic.sub.cc.i64", "@arm_decreased") + _DECREASED
        text = re.sub(r"@llvm\.(exp2|log|floor)\.f64\b", r"@\1", text)
        text = re.sub(r"@llvm\.(memset|memcpy|memmove)(\.p0)+\.i64\b", r"@\1", text)
        text = re.sub(r"(?m)^(declare void @mem.*) immarg", r"\1", text)
        names = re.findall(r"(?m)^declare [^@]*@([A-Za-z_]\w*)\(", text) + re.findall(r"(?m)^@(\w+) = external", text)
        # LLVM's table of symbols is one for the whole process.
        text = re.sub(rf"@({'|'.join(names)})\b", r"@arm_\1", text)
        for i, each in enumerate(names):
            llvm.add_symbol(f"arm_{each}", _OUTSIDE + i * _STRIDE)
        module = llvm.parse_assembly(text)
        machine = llvm.Target.from_triple(_TRIPLE).create_target_machine(cpu="cortex-a72", opt=3, codemodel="large")
        self._engine = llvm.create_mcjit_compiler(module, machine)
        self._engine.finalize_object()
        return names, self._engine.get_function_address(name)

    def __call__(self, *arguments: Any) -> None:
        """Calls the function, which returns nothing."""
        room = np.zeros(16, dtype=np.int64)
        words = [room.ctypes.data, room.ctypes.data + 64, *_flat(arguments)]
        floats = [word for word in words if isinstance(word, float)]
        assert len(floats) <= len(_FLOATS)
        integers = [word for word in words if not isinstance(word, float)]
        for register, word in zip(_FLOATS, floats, strict=False):
            self._processor.reg_write(register, _bits(word))
        for register, word in zip(_INTEGERS, integers, strict=False):
            self._processor.reg_write(register, word)
        stacked = integers[len(_INTEGERS) :]
        top = _STACK + _STACK_BYTES - _PAGE - 16 * len(stacked)
        self._processor.mem_write(top, struct.pack(f"<{len(stacked)}Q", *stacked))
        self._processor.reg_write(arm.UC_ARM64_REG_SP, top)
        end = _OUTSIDE + 0xF000
        self._processor.reg_write(arm.UC_ARM64_REG_LR, end)
        self._processor.emu_start(self._begin, end)
        assert self._processor.reg_read(arm.UC_ARM64_REG_PC) == end
        assert self._processor.reg_read(_INTEGERS[0]) & 0xFFFFFFFF == 0  # no exception
        self._held.clear()

    def _share(self, *access: Any) -> bool:
        """Shows the processor the pages of this process that it asks for."""
        _, _, address, size, _, _ = access
        for page in {address // _PAGE, (address + size - 1) // _PAGE}:
            at = page * _PAGE
            self._processor.mem_map_ptr(at, _PAGE, unicorn.UC_PROT_ALL, at)
        return True

    def _outside(self, *at: Any) -> None:
        """What a function from outside does."""
        number, inside = divmod(at[1] - _OUTSIDE, _STRIDE)
        if inside:
            return
        name, read = self._names[number], self._processor.reg_read
        first, second, third = (read(register) for register in _INTEGERS[:3])
        number = struct.unpack("<d", struct.pack("<Q", read(_FLOATS[0])))[0]
        if name in ("exp2", "log", "floor"):
            function: Callable[[float], float] = getattr(np, name)
            self._processor.reg_write(_FLOATS[0], _bits(float(function(number))))
        elif name == "numba_frexp":
            fraction, exponent = math.frexp(number)
            self._processor.reg_write(_FLOATS[0], _bits(fraction))
            self._processor.mem_write(first, struct.pack("<i", exponent))
        elif name == "numba_ldexp":
            (exponent,) = struct.unpack("<i", struct.pack("<I", first & 0xFFFFFFFF))
            self._processor.reg_write(_FLOATS[0], _bits(math.ldexp(number, exponent)))
        elif name == "NRT_MemInfo_alloc_aligned":
            self._processor.reg_write(_INTEGERS[0], self._allocated(first, second & 0xFFFFFFFF))
        elif name == "memset":
            _write(self._processor, first, bytes([second & 0xFF]) * third)
        elif name in ("memcpy", "memmove"):
            _write(self._processor, first, _read(self._processor, second, third))
        else:
            assert name == "NRT_MemInfo_call_dtor", name

    def _allocated(self, size: int, alignment: int) -> int:
        """A record of memory as numba has it: count, two functions, where it is, size, allocator."""
        self._held.append(np.zeros(size + alignment + 64, dtype=np.uint8))
        record = self._held[-1].ctypes.data
        at = record + 48
        at += -at % max(alignment, 1)
        ctypes.memmove(record, struct.pack("<6Q", 1, 0, 0, at, size, 0), 48)
        return record


def _write(processor: Any, at: int, data: bytes) -> None:
    if _STACK <= at < _STACK + _STACK_BYTES:
        processor.mem_write(at, data)
    else:
        ctypes.memmove(at, data, len(data))


def _read(processor: Any, at: int, size: int) -> bytes:
    if _STACK <= at < _STACK + _STACK_BYTES:
        return bytes(processor.mem_read(at, size))
    return ctypes.string_at(at, size)


def _flat(value: Any) -> Iterator[int | float]:
    """Words of an argument in the order in which numba hands them over."""
    if isinstance(value, tuple):
        for each in value:
            yield from _flat(each)
    elif isinstance(value, np.ndarray):
        yield from (0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides)
    elif isinstance(value, float):
        yield float(value)
    else:
        yield int(value)


def _bits(number: float) -> int:
    return struct.unpack("<Q", struct.pack("<d", number))[0]
