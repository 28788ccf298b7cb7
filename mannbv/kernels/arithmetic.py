"""What the tile kernels share: compiler flags, and 2ˣ in the precision of its argument.

A kernel is compiled once for float32, in use, and once for float64, in tests: constants take the type of the data.
"""

import math
from typing import Literal, NotRequired, TypedDict

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic, overload


class Options(TypedDict):
    """How kernels are compiled, as `numba.njit` takes it."""

    cache: bool
    nogil: bool
    fastmath: set[str]
    error_model: Literal["numpy"]
    parallel: NotRequired[bool]


# sums may be grouped as suits the processor, always in the same way; nan and inf are refused before a kernel runs
_FAST = {"nnan", "ninf", "nsz", "arcp", "contract", "afn", "reassoc"}
KERNEL: Options = {"cache": True, "nogil": True, "fastmath": _FAST, "error_model": "numpy"}
PARALLEL: Options = {**KERNEL, "parallel": True}

_C0, _C1, _C2, _C3, _C4, _C5 = (np.float32(math.log(2) ** k / math.factorial(k)) for k in range(6))
_BIAS, _MANTISSA = np.int32(127), np.int32(23)


@intrinsic
def _as_float(typing, bits):
    """The float32 with these bits."""

    def build(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], ir.FloatType())

    return types.float32(types.int32), build


@njit(**KERNEL)
def _exp2_single(x):
    """2ˣ to 3e-6, garbage below 2⁻¹²⁶: a polynomial and the exponent's bits, which a loop does in vectors."""
    whole = np.rint(x)
    part = x - whole
    power = _C0 + part * (_C1 + part * (_C2 + part * (_C3 + part * (_C4 + part * _C5))))
    bits = np.int32((np.int32(whole) + _BIAS) << _MANTISSA)
    return power * _as_float(bits)  # pyright: ignore[reportCallIssue]  numba adds the first argument


def exp2(x):
    """2ˣ, for kernels; float64 exactly."""
    raise NotImplementedError("exp2 lives in compiled code only")


@overload(exp2)
def _exp2(x):
    if x == types.float32:
        return lambda x: _exp2_single(x)
    return lambda x: math.exp(x * math.log(2.0))
