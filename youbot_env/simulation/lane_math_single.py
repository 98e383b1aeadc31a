"""The functions of ``lane_math`` in single precision: twice the rows an instruction.

Shorter polynomials, each to about the rounding of single precision (6e-8); their coefficients
interpolate at Chebyshev nodes with 40 digits.
"""

from __future__ import annotations

import numpy as np

from youbot_env.caching import njit
from youbot_env.simulation.lane_math import bits_of, fma, number_of

real = np.float32


@njit(cache=True, error_model="numpy", forceinline=True)
def ticks(n, turn, bits):
    """Turns of a clock that makes ``bits`` / 2^64 of a turn a tick, after n ticks, as bits.

    Whole numbers count turns exactly, so that a long episode's reference is as exact as a short
    one's.
    """
    return number_of(np.int32((np.uint64(n) * np.uint64(bits)) >> np.uint64(32)))


@njit(cache=True, error_model="numpy", forceinline=True)
def turns_of_tone(phase, harmonic, clock):
    """Turns of a tone [-0.5, 0.5) from its phase [turns / 65536], harmonic and ``ticks``."""
    turns = np.int32(np.int32(harmonic) * bits_of(clock)) + (np.int32(phase) << np.int32(16))
    return real(np.int32(turns)) * real(2.3283064365386963e-10)


@njit(cache=True, error_model="numpy", forceinline=True)
def sine_within(r):
    """sin(r) for |r| <= pi / 2."""
    z = r * r
    p = fma(z, real(2.6347445557912756e-06), real(-1.9822735835019672e-04))
    p = fma(z, p, real(8.33324210801853e-03))
    p = fma(z, p, real(-1.666666596354223e-01))
    return fma(z * r, p, r)


@njit(cache=True, error_model="numpy", forceinline=True)
def sin(x):
    """Sine of an angle [rad]: error below 2e-7 up to 1e4 rad."""
    k = np.rint(x * real(0.3183098861837907))
    r = fma(k, real(8.742278012618954e-08), fma(k, real(-3.1415927410125732), x))
    half = k * real(0.5)
    # Odd half turns change the sign.
    return sine_within(r) * (real(1.0) - real(4.0) * (half - np.floor(half)))


@njit(cache=True, error_model="numpy", forceinline=True)
def cos(x):
    """Cosine of an angle [rad]: error below 2e-7 up to 1e4 rad."""
    # cos(x) = sin(x + pi / 2), with the quarter turn taken off the number of half turns.
    k = np.rint(fma(x, real(0.3183098861837907), real(0.5)))
    quarter = k - real(0.5)
    r = fma(quarter, real(8.742278012618954e-08), fma(quarter, real(-3.1415927410125732), x))
    half = k * real(0.5)
    return sine_within(r) * (real(1.0) - real(4.0) * (half - np.floor(half)))


@njit(cache=True, error_model="numpy", forceinline=True)
def sine_of_little(d):
    """Sine of what a step turns [rad]: error below d^7 / 5040."""
    z = d * d
    return fma(z * d, fma(z, real(8.333333333333333e-03), real(-0.16666666666666666)), d)


@njit(cache=True, error_model="numpy", forceinline=True)
def cosine_of_little(d):
    """Cosine of what a step turns [rad]: error below d^8 / 40320."""
    z = d * d
    p = fma(z, real(-1.388888888888889e-03), real(4.1666666666666664e-02))
    return fma(z, fma(z, p, real(-0.5)), real(1.0))


@njit(cache=True, error_model="numpy", forceinline=True)
def sine_of_turns(u):
    """sin(2 pi u): error below 3e-7 and that of u itself."""
    r = u - np.rint(u)
    z = r * r
    p = fma(z, real(-0.7903124562990976), real(3.512360882746445))
    p = fma(z, p, real(-9.623957659434058))
    p = fma(z, p, real(16.769155766605394))
    p = fma(z, p, real(-16.208955680368824))
    p = fma(z, p, real(6.283185288677693))
    return p * (r * fma(real(-4.0), z, real(1.0)))


@njit(cache=True, error_model="numpy", forceinline=True)
def exponential(x):
    """e^x for -87 <= x <= 88 as (a, b) of sum a + b, where b is a power of two."""
    # x = k ln 2 + r with |r| <= ln 2 / 2.
    k = np.rint(x * real(1.4426950408889634))
    r = fma(k, real(1.904654323148236e-09), fma(k, real(-0.6931471824645996), x))
    p = fma(r, real(1.3926183587713494e-03), real(8.363179052722578e-03))
    p = fma(r, p, real(4.1666554617204574e-02))
    p = fma(r, p, real(1.6666576989698775e-01))
    p = fma(r, p, real(0.5))
    scale = power_of_two(k)
    return scale * fma(r * r, p, r), scale


@njit(cache=True, error_model="numpy", forceinline=True)
def power_of_two(k):
    """2^k for whole k of a normal number."""
    # In this sum the last bits of the mantissa are k, which then move into the exponent's place.
    moved = bits_of(k + real(12582912.0)) + np.int32(127)
    return number_of(np.int32(np.int32(moved) << np.int32(23)))


@njit(cache=True, error_model="numpy", forceinline=True)
def exp(x):
    """e^x, cut to its values from x = -87 to 88: relative error below 3e-7."""
    # Written so that NaN stays NaN.
    x = real(-87.0) if x < real(-87.0) else x
    x = real(88.0) if x > real(88.0) else x
    a, b = exponential(x)
    return a + b


@njit(cache=True, error_model="numpy", forceinline=True)
def tanh(x):
    """Hyperbolic tangent: relative error below 3e-7."""
    size = abs(x)
    size = real(10.0) if size > real(10.0) else size  # there it is 1 to rounding
    a, b = exponential(real(-2.0) * size)
    # Not e^x - 1 of a sum that is rounded: near 0 the result keeps all its digits.
    less = a + (b - real(1.0))
    value = -less / (less + real(2.0))
    return -value if x < real(0.0) else value


@njit(cache=True, error_model="numpy", forceinline=True)
def log_of_share(u):
    """ln(u) for a normal number 0 < u < 1: relative error below 3e-7."""
    bits = bits_of(u)
    # The exponent, counted from sqrt(1/2), so that the mantissa is within sqrt(1/2) to sqrt(2).
    exponent = np.int32(np.int32(bits - np.int32(1060439283)) >> np.int32(23))
    mantissa = number_of(np.int32(bits - np.int32(exponent << np.int32(23))))
    s = (mantissa - real(1.0)) / (mantissa + real(1.0))
    z = s * s
    p = fma(z, real(0.14962195239572493), real(0.19987425258759525))
    p = fma(z, p, real(0.33333407669075593))
    p = fma(z, p, real(1.0))
    return fma(real(exponent), real(0.6931471805599453), real(2.0) * s * p)
