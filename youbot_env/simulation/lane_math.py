"""Elementary functions that a compiler can evaluate for several rows at once, to the same bits.

A loop over rows becomes vector instructions only if nothing in it is a call into the C library, and
a row gives the same bits in a vector loop and in its scalar remainder only if every operation is
rounded as IEEE 754 says. So these functions are polynomials over additions, multiplications and
fused multiply-adds. Their coefficients interpolate at Chebyshev nodes with 60 digits; the errors
in the docstrings are those of double precision.

``real`` is the type of the numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from youbot_env.caching import njit

real = np.float64


def _fma(typing, a, b, c):
    """a b + c, rounded once: the same bits in vectors and alone, on every machine."""

    def generate(context, builder, signature, arguments):
        return builder.fma(*arguments)

    return a(a, a, a), generate


def _bits_of(typing, x):
    """The bits of a number in double or single precision, as an integer of that size."""
    whole = types.int64 if x == types.float64 else types.int32

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(whole))

    return whole(x), generate


def _number_of(typing, bits):
    """The inverse of ``bits_of``."""
    number = types.float64 if bits == types.int64 else types.float32

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(number))

    return number(bits), generate


def _pointer(typing, address):
    """A pointer to what stands at an address."""

    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.intp), generate


def _fetch(typing, array, i):
    """Ask the memory for what stands at number i of an array: it comes while others are used."""

    def generate(context, builder, signature, arguments):
        data = make_array(signature.args[0])(context, builder, arguments[0]).data
        place = context.get_value_type(types.voidptr)
        place = builder.bitcast(builder.gep(data, [arguments[1]]), place)
        kind = ir.FunctionType(ir.VoidType(), [place.type, *[ir.IntType(32)] * 3])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        # To be read, worth the second-level cache, data.
        builder.call(function, [place, *(ir.Constant(ir.IntType(32), n) for n in (0, 2, 1))])
        return context.get_dummy_value()

    return types.void(array, types.intp), generate


def _taken_before(typing, taken, more):
    """What stood in an array's first number before ``more`` was added, at once for all threads."""

    def generate(context, builder, signature, arguments):
        array = make_array(signature.args[0])(context, builder, arguments[0])
        return builder.atomic_rmw("add", array.data, arguments[1], "seq_cst")

    return types.int64(taken, types.int64), generate


def _apart(builder, instruction, own, other):
    """Say of a load or store that it never touches what the other kind touches."""
    module = builder.module
    domain = module.add_metadata(["youbot"])
    scopes = {name: module.add_metadata([name, domain]) for name in ("youbot in", "youbot out")}
    instruction.set_metadata("alias.scope", module.add_metadata([scopes[own]]))
    instruction.set_metadata("noalias", module.add_metadata([scopes[other]]))


def _given(typing, array, i):
    """Number i of an array, i at least 0, that no ``put`` of the same loop writes elsewhere."""

    def generate(context, builder, signature, arguments):
        kind = signature.args[0]
        data = make_array(kind)(context, builder, arguments[0]).data
        place = builder.gep(data, [arguments[1]], inbounds=True)
        found = context.unpack_value(builder, kind.dtype, place)
        _apart(builder, found, "youbot in", "youbot out")
        return found

    return array.dtype(array, types.intp), generate


def _put(typing, array, i, value):
    """Write number i of an array, i at least 0, that no ``given`` of the same loop reads."""

    def generate(context, builder, signature, arguments):
        kind = signature.args[0]
        data = make_array(kind)(context, builder, arguments[0]).data
        place = builder.gep(data, [arguments[1]], inbounds=True)
        written = builder.store(context.get_value_as_data(builder, kind.dtype, arguments[2]), place)
        _apart(builder, written, "youbot out", "youbot in")

    return types.void(array, types.intp, array.dtype), generate


Compiled = Callable[..., Any]

fma: Compiled = intrinsic(_fma)  # pyright: ignore[reportAssignmentType, reportCallIssue]
taken_before: Compiled = intrinsic(_taken_before)  # pyright: ignore[reportAssignmentType, reportCallIssue]
given: Compiled = intrinsic(_given)  # pyright: ignore[reportAssignmentType, reportCallIssue]
put: Compiled = intrinsic(_put)  # pyright: ignore[reportAssignmentType, reportCallIssue]
fetch: Compiled = intrinsic(_fetch)  # pyright: ignore[reportAssignmentType, reportCallIssue]
pointer: Compiled = intrinsic(_pointer)  # pyright: ignore[reportAssignmentType, reportCallIssue]
bits_of: Compiled = intrinsic(_bits_of)  # pyright: ignore[reportAssignmentType, reportCallIssue]
number_of: Compiled = intrinsic(_number_of)  # pyright: ignore[reportAssignmentType, reportCallIssue]


@njit(cache=True, error_model="numpy", forceinline=True)
def ticks(n, turn, bits):
    """Turns of a clock that makes ``turn`` of a turn a tick, after n ticks.

    ``bits``: the same in units of 2^-64, for single precision.
    """
    return real(n) * turn


@njit(cache=True, error_model="numpy", forceinline=True)
def turns_of_tone(phase, harmonic, clock):
    """Turns of a tone from its phase [turns / 65536], its harmonic and ``ticks``."""
    return fma(real(harmonic), clock, real(phase) * 1.52587890625e-05)


@njit(cache=True, error_model="numpy", forceinline=True)
def sine_within(r):
    """sin(r) for |r| <= pi / 2: error below 1e-16."""
    z = r * r
    p = fma(z, 2.7314447669863995e-15, -7.643970296798572e-13)
    p = fma(z, p, 1.6058977312464087e-10)
    p = fma(z, p, -2.5052107616996182e-08)
    p = fma(z, p, 2.7557319219163234e-06)
    p = fma(z, p, -1.9841269841254974e-04)
    p = fma(z, p, 8.333333333333316e-03)
    p = fma(z, p, -1.6666666666666666e-01)
    return fma(z * r, p, r)


@njit(cache=True, error_model="numpy", forceinline=True)
def sin(x):
    """Sine of an angle [rad]: error below 3e-16 up to 1e5 rad."""
    k = np.rint(x * 0.3183098861837907)
    r = fma(k, -1.2246467991473532e-16, fma(k, -3.141592653589793, x))
    half = k * 0.5
    # Odd half turns change the sign.
    return sine_within(r) * (1.0 - 4.0 * (half - np.floor(half)))


@njit(cache=True, error_model="numpy", forceinline=True)
def cos(x):
    """Cosine of an angle [rad]: error below 3e-16 up to 1e5 rad."""
    # cos(x) = sin(x + pi / 2), with the quarter turn taken off the number of half turns.
    k = np.rint(fma(x, 0.3183098861837907, 0.5))
    quarter = k - 0.5
    r = fma(quarter, -1.2246467991473532e-16, fma(quarter, -3.141592653589793, x))
    half = k * 0.5
    return sine_within(r) * (1.0 - 4.0 * (half - np.floor(half)))


@njit(cache=True, error_model="numpy", forceinline=True)
def sine_of_little(d):
    """Sine of what a step turns [rad]: error below d^9 / 362880.

    Up to 0.07 rad that is rounding beside the sines of size 1 that it turns, and always far below
    what a Runge-Kutta step that turns so far leaves, some d^5 / 2880.
    """
    z = d * d
    p = fma(z, fma(z, -1.984126984126984e-04, 8.333333333333333e-03), -0.16666666666666666)
    return fma(z * d, p, d)


@njit(cache=True, error_model="numpy", forceinline=True)
def cosine_of_little(d):
    """Cosine of what a step turns [rad]: error below d^10 / 3628800, see ``sine_of_little``."""
    z = d * d
    p = fma(z, fma(z, 2.48015873015873e-05, -1.388888888888889e-03), 4.1666666666666664e-02)
    return fma(z, fma(z, p, -0.5), 1.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def sine_of_turns(u):
    """sin(2 pi u): error below 1e-14 and that of u itself."""
    r = u - np.rint(u)
    z = r * r
    p = fma(z, 0.0026421047021664068, -0.025186032829809836)
    p = fma(z, p, 0.173165667802042)
    p = fma(z, p, -0.9116831470146207)
    p = fma(z, p, 3.5457381690524445)
    p = fma(z, p, -9.628238814646439)
    p = fma(z, p, 16.769405228838217)
    p = fma(z, p, -16.208961011676625)
    p = fma(z, p, 6.283185307179579)
    return p * (r * fma(-4.0, z, 1.0))


@njit(cache=True, error_model="numpy", forceinline=True)
def exponential(x):
    """e^x for -708 <= x <= 709 as (a, b) of sum a + b, where b is a power of two."""
    # x = k ln 2 + r with |r| <= ln 2 / 2.
    k = np.rint(x * 1.4426950408889634)
    r = fma(k, -2.3190468138462996e-17, fma(k, -0.6931471805599453, x))
    p = fma(r, 2.0914679376583935e-09, 2.510520637395701e-08)
    p = fma(r, p, 2.7557273661348637e-07)
    p = fma(r, p, 2.7557255425746435e-06)
    p = fma(r, p, 2.4801587325533363e-05)
    p = fma(r, p, 1.9841269874800493e-04)
    p = fma(r, p, 1.3888888888883752e-03)
    p = fma(r, p, 8.333333333326141e-03)
    p = fma(r, p, 4.166666666666667e-02)
    p = fma(r, p, 1.6666666666666670e-01)
    p = fma(r, p, 0.5)
    scale = power_of_two(k)
    return scale * fma(r * r, p, r), scale


@njit(cache=True, error_model="numpy", forceinline=True)
def power_of_two(k):
    """2^k for whole k of a normal number."""
    # In this sum the last bits of the mantissa are k, which then move into the exponent's place.
    return number_of((bits_of(k + 6755399441055744.0) + np.int64(1023)) << np.int64(52))


@njit(cache=True, error_model="numpy", forceinline=True)
def exp(x):
    """e^x, cut to its values from x = -708 to 709: relative error below 4e-16."""
    # Written so that NaN stays NaN.
    x = -708.0 if x < -708.0 else x
    x = 709.0 if x > 709.0 else x
    a, b = exponential(x)
    return a + b


@njit(cache=True, error_model="numpy", forceinline=True)
def tanh(x):
    """Hyperbolic tangent: relative error below 5e-16."""
    size = abs(x)
    size = 22.0 if size > 22.0 else size  # there it is 1 to rounding
    a, b = exponential(-2.0 * size)
    # Not e^x - 1 of a sum that is rounded: near 0 the result keeps all its digits.
    less = a + (b - 1.0)
    value = -less / (less + 2.0)
    return -value if x < 0.0 else value


@njit(cache=True, error_model="numpy", forceinline=True)
def log_of_share(u):
    """ln(u) for a normal number 0 < u < 1: relative error below 1e-14."""
    bits = bits_of(u)
    # The exponent, counted from sqrt(1/2), so that the mantissa is within sqrt(1/2) to sqrt(2).
    shifted = bits - np.int64(4604544271217802189)
    exponent = shifted >> np.int64(52)
    mantissa = number_of(bits - (exponent << np.int64(52)))
    s = (mantissa - 1.0) / (mantissa + 1.0)
    z = s * s
    p = fma(z, 0.08418829985340244, 0.09060967215607607)
    p = fma(z, p, 0.11111717273758953)
    p = fma(z, p, 0.14285708010553835)
    p = fma(z, p, 0.20000000030870807)
    p = fma(z, p, 0.3333333333327646)
    p = fma(z, p, 1.0)
    return fma(real(exponent), 0.6931471805599453, 2.0 * s * p)
