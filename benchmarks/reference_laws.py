"""Friction laws written from their published equations, for the fine simulation that fraexp is compared with.

Nothing is shared with the plugins. A law gives the *mean* force over a short step, along which the displacement goes
straight: the forces are integrated over the step, where fraexp takes them at its end. Parameters are one flat array.
"""

import math

from numba import njit

NONE, ELEMENTS, FORCE_SLIDERS, BRISTLE, GMS, COULOMB = range(6)
"""Kinds of law; DAHL, LuGre and elastoplastic friction are bristles."""


@njit
def _integral_of_limited(x, limit):
    """Return the integral of clip(x, -limit, limit) from 0 to x."""
    size = abs(x)
    return 0.5 * x * x if size <= limit else limit * (size - 0.5 * limit)


@njit
def _mean_limited(begin, end, limit):
    """Return the mean of clip(q, -limit, limit) while q goes straight from begin to end."""
    if abs(begin) <= limit and abs(end) <= limit:
        return 0.5 * (begin + end)
    if abs(end - begin) < 1e-9 * limit:
        return min(max(0.5 * (begin + end), -limit), limit)
    return (_integral_of_limited(end, limit) - _integral_of_limited(begin, limit)) / (end - begin)


@njit
def _elements(z, dy, h, parameters, z_next):
    """Eqs (6)-(11) of the paper with eq (9) as the slider: K_i, D_i and Y_i, one after another."""
    count, force = parameters.size // 3, 0.0
    for i in range(count):
        k, d, width = parameters[3 * i], parameters[3 * i + 1], parameters[3 * i + 2]
        end = z[i] + dy
        if abs(end) <= width:
            z_next[i] = end
            force += _mean_limited(k * z[i] + d * dy / h, k * end + d * dy / h, k * width)
            continue
        edge = math.copysign(width, dy)
        z_next[i] = edge
        sticking = (edge - z[i]) / dy
        if sticking > 0.0:
            force += sticking * _mean_limited(k * z[i] + d * dy / h, k * edge + d * dy / h, k * width)
        force += (1.0 - sticking) * k * edge
    return force


@njit
def _force_sliders(z, dy, h, parameters, z_next):
    """The same with eq (10) as the slider: spring and dashpot side by side, behind a slider of force K_i Y_i."""
    count, force, sign = parameters.size // 3, 0.0, math.copysign(1.0, dy)
    for i in range(count):
        k, d, width = parameters[3 * i], parameters[3 * i + 1], parameters[3 * i + 2]
        limit, viscous = k * width, d * dy / h
        begin, end = k * z[i] + viscous, k * (z[i] + dy) + viscous
        if sign * end <= limit:
            z_next[i] = z[i] + dy
            force += 0.5 * (begin + end)
            continue
        sticking = max(sign * limit - begin, 0.0) / (end - begin) if sign * begin < limit else 0.0
        if sticking > 0.0:
            force += sticking * 0.5 * (begin + sign * limit)
        start, rest = z[i] + sticking * dy, sign * width
        decay = math.exp(-k * (1.0 - sticking) * h / d) if d > 0.0 else 0.0
        z_next[i] = rest + (start - rest) * decay
        force += (1.0 - sticking) * sign * limit
    return force


@njit
def _stribeck(speed, coulomb, static, velocity, exponent):
    return coulomb + (static - coulomb) * math.exp(-((speed / velocity) ** exponent))


@njit
def _bristle_slope(z, sign, steady, elastic):
    """Return dz/dy: 1 - α z/z_ss sgn v, where α is 1 below an elastic limit of 0 (LuGre, Dahl)."""
    along = sign * z
    if elastic <= 0.0:
        return 1.0 - along / steady
    if along <= elastic:
        return 1.0
    if along >= steady:
        return 1.0 - along / steady
    alpha = 0.5 + 0.5 * math.sin(math.pi * (along - 0.5 * (steady + elastic)) / (steady - elastic))
    return 1.0 - alpha * along / steady


@njit
def _bristle(z, dy, h, parameters, z_next):
    """F = σ0 z + σ1 ż, by the classical Runge-Kutta method over the path: σ0, σ1, Fc, Fs, vs, z_ba."""
    stiffness, damping, coulomb, static, velocity, elastic = parameters
    steady = _stribeck(abs(dy) / h, coulomb, static, velocity, 2.0) / stiffness
    sign, end, area = math.copysign(1.0, dy), z[0], 0.0
    pieces = int(abs(dy) / (0.1 * steady)) + 1
    path = dy / pieces
    for _ in range(pieces):
        one = _bristle_slope(end, sign, steady, elastic)
        two = _bristle_slope(end + 0.5 * path * one, sign, steady, elastic)
        three = _bristle_slope(end + 0.5 * path * two, sign, steady, elastic)
        four = _bristle_slope(end + path * three, sign, steady, elastic)
        after = end + path * (one + 2 * two + 2 * three + four) / 6
        area += (0.5 * (end + after) - path * (four - one) / 12) / pieces
        end = after
    z_next[0] = end
    return stiffness * area + damping * (end - z[0]) / h


@njit
def _gms(z, dy, h, parameters, z_next):
    """Stick: Ḟ = k v until sgn(v) F = α S; slip: Ḟ = sgn(v) C (α - sgn(v) F/S): Fc, Fs, vs, δ, C, then k_i and α_i."""
    count = (parameters.size - 5) // 2
    steady = _stribeck(abs(dy) / h, parameters[0], parameters[1], parameters[2], parameters[3])
    rate, sign, force = parameters[4] / steady, math.copysign(1.0, dy), 0.0
    turned = sign != z[2 * count]
    z_next[2 * count] = sign
    for i in range(count):
        k, limit = parameters[5 + 2 * i], sign * parameters[6 + 2 * i] * steady
        begin, sticking = z[i], 0.0
        slips = z[count + i] > 0.0 and not turned
        if not slips:
            end = z[i] + k * dy
            sticking = 1.0 if sign * (end - limit) < 0.0 else max((limit - z[i]) / (k * dy), 0.0) if dy != 0.0 else 1.0
            begin = z[i] + sticking * k * dy
            force += sticking * 0.5 * (z[i] + begin)
        rest = 1.0 - sticking
        half = 0.5 * rate * rest * h
        z_next[i] = limit + (begin - limit) * (1.0 - half) / (1.0 + half)
        z_next[count + i] = 1.0 if rest > 0.0 else 0.0
        force += rest * 0.5 * (begin + z_next[i])
    return force


@njit
def mean_force(kind, z, dy, h, parameters, z_next):
    """Return the mean force [N] while the displacement goes straight by dy [m] in h [s]; fill in the next state."""
    if kind == ELEMENTS:
        return _elements(z, dy, h, parameters, z_next)
    if kind == FORCE_SLIDERS:
        return _force_sliders(z, dy, h, parameters, z_next)
    if kind == BRISTLE:
        return _bristle(z, dy, h, parameters, z_next)
    return _gms(z, dy, h, parameters, z_next) if kind == GMS else 0.0


@njit
def coulomb_force(z, velocity, free_velocity, gain, parameters, z_next):
    """Return the mean force [N] of set-valued Coulomb friction with Stribeck effect: Fc, Fs, vs, δ.

    Without friction the velocity would go from `velocity` to `free_velocity` in the step; a force takes `gain` times
    itself off. While it sticks (z[0] = 1) the force is what holds; it slides on, stops, or turns within the step.
    """
    fc, fs, vs, exponent = parameters
    hold = (free_velocity - velocity) / gain
    if z[0] > 0.0:
        if abs(hold) <= fs:
            z_next[0] = 1.0
            return free_velocity / gain
        sign, before = math.copysign(1.0, hold), 0.0
    else:
        sign, before = math.copysign(1.0, velocity), velocity
    z_next[0] = 0.0
    after = before
    for _ in range(50):
        force = sign * _stribeck(0.5 * abs(before + after), fc, fs, vs, exponent)
        last, after = after, free_velocity - gain * force
        if abs(after - last) < 1e-15:
            break
    if after * sign >= 0.0:
        return force
    if abs(hold) <= fs:
        z_next[0] = 1.0
        return free_velocity / gain
    # It turns: one force until the velocity is zero, the other one after it.
    slowing = sign * _stribeck(0.5 * abs(before), fc, fs, vs, exponent)
    share, after = before / (before - (free_velocity - gain * slowing)), 0.0
    for _ in range(50):
        force = share * slowing - (1.0 - share) * sign * _stribeck(0.5 * abs(after), fc, fs, vs, exponent)
        last, after = after, free_velocity - gain * force
        if abs(after - last) < 1e-15:
            break
    return force
