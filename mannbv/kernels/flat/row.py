"""Flatland's one-row images: project, composite, differentiate, and the information of a view or of all yaws.

A splat moves a pixel only through its centre u [px], its variance var [px²] and its opacity logit, so `chain` keeps
∂u/∂mean (2) and ∂var/∂(mean, log-scales, rotation) (5) in the world frame, and every sum over pixels is one over
powers of δ = pixel − u. Splats come front to back. All arithmetic is in float64.
"""

import math

import numpy as np
from numba import njit

from mannbv.kernels.limits import MAX_BLEND


@njit(cache=True, nogil=True)
def project(means, log_scales, rotations, rotation, position, focal, width, limit, near, low_pass, around):
    """The splats before the camera, front to back.

    rotation: (2, 2), columns right and forward. limit: largest slope of the Jacobian's ray. around: all directions,
    u an angle times focal instead of a pixel. Returns index (v,), u, var, depth (v,) and chain (v, 7).
    """
    n = len(means)
    index, far = np.empty(n, np.int64), np.empty(n)
    u, var, depth, chain = np.empty(n), np.empty(n), np.empty(n), np.zeros((n, 15 if around else 7))
    v = 0
    for s in range(n):
        ax, ay = means[s, 0] - position[0], means[s, 1] - position[1]
        x = ax * rotation[0, 0] + ay * rotation[1, 0]
        z = ax * rotation[0, 1] + ay * rotation[1, 1]
        square = x * x + z * z
        if around:
            if square <= near * near:
                continue
            jx, jz = focal * z / square, -focal * x / square
            ux, uz = jx, jz
            cross = -2.0 * focal * x * z / (square * square)
            along = focal * (x * x - z * z) / (square * square)
            jxx, jxz, jzx, jzz = cross, along, along, -cross
            u[v] = focal * math.atan2(x, z)
        else:
            if z <= near:
                continue
            ray = x / z
            inside = 1.0 if abs(ray) < limit else 0.0
            held = min(max(ray, -limit), limit)
            jx, jz = focal / z, -focal * held / z
            ux, uz = focal / z, -focal * ray / z
            jxx, jxz = 0.0, -focal / (z * z)
            jzx, jzz = -inside * focal / (z * z), focal * held / (z * z) + inside * focal * ray / (z * z)
            u[v] = focal * ray + 0.5 * width
        length = math.hypot(rotations[s, 0], rotations[s, 1])
        cos, sin = rotations[s, 0] / length, rotations[s, 1] / length
        bx = jx * rotation[0, 0] + jz * rotation[0, 1]
        by = jx * rotation[1, 0] + jz * rotation[1, 1]
        first, second = bx * cos + by * sin, by * cos - bx * sin  # the image's slope along the splat's axes
        wide, thin = math.exp(2.0 * log_scales[s, 0]), math.exp(2.0 * log_scales[s, 1])
        var[v] = wide * first * first + thin * second * second + low_pass
        qx = wide * first * cos - thin * second * sin  # Σ b, b the slope in the world
        qy = wide * first * sin + thin * second * cos
        hx = qx * rotation[0, 0] + qy * rotation[1, 0]
        hz = qx * rotation[0, 1] + qy * rotation[1, 1]
        vx, vz = 2.0 * (hx * jxx + hz * jzx), 2.0 * (hx * jxz + hz * jzz)
        for a in range(2):
            chain[v, a] = ux * rotation[a, 0] + uz * rotation[a, 1]
            chain[v, 2 + a] = vx * rotation[a, 0] + vz * rotation[a, 1]
        chain[v, 4], chain[v, 5] = 2.0 * wide * first * first, 2.0 * thin * second * second
        chain[v, 6] = 2.0 * (wide - thin) * first * second
        if around:  # the same along the line of sight: covariance with the angle and variance, and their slopes
            rx, rz = focal * x / square, focal * z / square
            bx = rx * rotation[0, 0] + rz * rotation[0, 1]
            by = rx * rotation[1, 0] + rz * rotation[1, 1]
            third, fourth = bx * cos + by * sin, by * cos - bx * sin
            chain[v, 7], chain[v, 8] = wide * first * third + thin * second * fourth, wide * third**2 + thin * fourth**2
            chain[v, 9], chain[v, 10] = 2.0 * wide * first * third, 2.0 * thin * second * fourth
            chain[v, 11] = (wide - thin) * (second * third + first * fourth)
            chain[v, 12], chain[v, 13] = 2.0 * wide * third**2, 2.0 * thin * fourth**2
            chain[v, 14] = 2.0 * (wide - thin) * third * fourth
        index[v], far[v], depth[v] = s, square, z
        v += 1
    order = np.argsort(far[:v], kind="mergesort")
    return index[:v][order], u[:v][order], var[:v][order], depth[:v][order], chain[:v][order]


@njit(cache=True, nogil=True)
def _span(u, var, opacity, width, cutoff):
    """First and last pixel whose blend reaches the cutoff."""
    if cutoff <= 0.0:
        return 0, width - 1
    if opacity <= cutoff:
        return 0, -1
    reach = math.sqrt(2.0 * var * math.log(opacity / cutoff))
    return max(math.ceil(u - reach - 0.5), 0), min(math.floor(u + reach - 0.5), width - 1)


@njit(cache=True, nogil=True)
def composite(u, var, opacity, values, width, cutoff, floor):
    """Eq. (1): Σ value · ρ Π(1 − ρ) for values (v, c) → (c + 1, width); the last row is the opacity.

    cutoff: blends below it are dropped. floor: a pixel with less transmittance is full.
    """
    channels = values.shape[1]
    image, through = np.zeros((channels + 1, width)), np.ones(width)
    for s in range(len(u)):
        first, last = _span(u[s], var[s], opacity[s], width, cutoff)
        for p in range(first, last + 1):
            if through[p] < floor:
                continue
            raw = opacity[s] * math.exp(-0.5 * (p + 0.5 - u[s]) ** 2 / var[s])
            rho = min(raw, MAX_BLEND)
            weight = rho * through[p]
            for c in range(channels):
                image[c, p] += weight * values[s, c]
            image[channels, p] += weight
            through[p] -= weight
    return image


@njit(cache=True, nogil=True)
def backward(u, var, opacity, values, image, slopes, width, cutoff, floor):
    """Gradient of Σ slopes · image, slopes (c + 1, width): by u, var, logit (v, 3) and by values (v, c)."""
    channels = values.shape[1]
    q, by_value = np.zeros((len(u), 3)), np.zeros((len(u), channels))
    through, before = np.ones(width), np.zeros(width)
    total = (slopes * image).sum(0)
    for s in range(len(u)):
        first, last = _span(u[s], var[s], opacity[s], width, cutoff)
        zero, one, two = 0.0, 0.0, 0.0
        for p in range(first, last + 1):
            if through[p] < floor:
                continue
            delta = p + 0.5 - u[s]
            raw = opacity[s] * math.exp(-0.5 * delta * delta / var[s])
            rho = min(raw, MAX_BLEND)
            weight = rho * through[p]
            shown = slopes[channels, p]
            for c in range(channels):
                shown += slopes[c, p] * values[s, c]
                by_value[s, c] += slopes[c, p] * weight
            before[p] += weight * shown
            if raw <= MAX_BLEND:
                push = rho * (through[p] * shown - (total[p] - before[p]) / (1.0 - rho))
                zero += push
                one += push * delta
                two += push * delta * delta
            through[p] -= weight
        q[s, 0], q[s, 1], q[s, 2] = one / var[s], 0.5 * two / var[s] ** 2, zero * (1.0 - opacity[s])
    return q, by_value


@njit(cache=True, nogil=True)
def fisher(u, var, opacity, depth, chain, colors, forward, counts, width, sigma_color, sigma_depth, cutoff, floor):
    """diag(JᵀJ) (v, 9) of the splats that count (v,): mean, log-scales, rotation, logit, colour."""
    values = np.concatenate((colors / sigma_color, depth.reshape(-1, 1) / sigma_depth), 1)
    image = composite(u, var, opacity, values, width, cutoff, floor)
    rows = np.zeros((len(u), 9))
    through, before = np.ones(width), np.zeros((4, width))
    for s in range(len(u)):
        first, last = _span(u[s], var[s], opacity[s], width, cutoff)
        e0, e1, e2, e3, e4, f1, f2, seen = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for p in range(first, last + 1):
            if through[p] < floor:
                continue
            delta = p + 0.5 - u[s]
            raw = opacity[s] * math.exp(-0.5 * delta * delta / var[s])
            rho = min(raw, MAX_BLEND)
            weight = rho * through[p]
            energy, lift = 0.0, 0.0
            for c in range(4):
                before[c, p] += weight * values[s, c]
                lift = through[p] * values[s, c] - (image[c, p] - before[c, p]) / (1.0 - rho)
                energy += lift * lift
            if raw <= MAX_BLEND and counts[s]:
                energy *= rho * rho
                cross = rho * lift * weight  # depth is the last channel, so this lift is depth's
                e0 += energy
                e1 += energy * delta
                e2 += energy * delta**2
                e3 += energy * delta**3
                e4 += energy * delta**4
                f1 += cross * delta
                f2 += cross * delta**2
            seen += weight * weight
            through[p] -= weight
        uu, uv, vv = e2 / var[s] ** 2, 0.5 * e3 / var[s] ** 3, 0.25 * e4 / var[s] ** 4
        for a in range(2):
            du, dv = chain[s, a], chain[s, 2 + a]
            rows[s, a] = du * du * uu + 2.0 * du * dv * uv + dv * dv * vv
            rows[s, a] += 2.0 * forward[a] / sigma_depth * (du * f1 / var[s] + 0.5 * dv * f2 / var[s] ** 2)
            rows[s, a] += forward[a] ** 2 * seen / sigma_depth**2
        for a in range(3):
            rows[s, 2 + a] = chain[s, 4 + a] ** 2 * vv
        rows[s, 5] = (1.0 - opacity[s]) ** 2 * e0
        for c in range(3):
            rows[s, 6 + c] = seen / sigma_color**2
    return rows


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "arcp"})
def densities(
    compass, var, opacity, relative, chain, colors, worth, focal, slant, low_pass, limit, near, sigma_color,
    sigma_depth, cutoff,
):  # fmt: skip
    """What a pixel would gain, at every direction (columns, 4): colour, and depth's xx, xy, yy in the camera's axis.

    compass (columns, 2): sine and cosine of directions in equal steps from −π to the right. var (v,), chain: as
    `project` gives them for all directions, without low pass. slant, low_pass: the pixel's place in its image, tan φ,
    and 0.3 cos⁴φ there. limit: largest slope of the Jacobian's ray, which clamps splats beside the image as `project`
    does. near [m]: along the camera's axis. relative (v, 2): means less the camera's position, in the world frame.
    worth (v, 9): v / (H + λ), 0 for occluders.

    Splats are added from the back: one in front lets 1 − ρ of every later lift and weight through, so (1 − ρ)² of
    what had been gained.
    """
    values = np.concatenate((colors / sigma_color, relative / sigma_depth), 1)
    columns = len(compass)
    step, by_depth, hidden = 2.0 * math.pi / columns, 1.0 / sigma_depth, near * math.sqrt(1.0 + slant * slant)
    behind, gain = np.zeros((columns, 5)), np.zeros((columns, 4))
    for s in range(len(var) - 1, -1, -1):
        if opacity[s] <= cutoff:
            continue
        x_worth, y_worth, counts, open_shape = worth[s, 0], worth[s, 1], worth[s].any(), 0.0
        color_worth = (worth[s, 6] + worth[s, 7] + worth[s, 8]) / sigma_color**2
        for a in range(3):
            open_shape += worth[s, 2 + a] * chain[s, 4 + a] ** 2
        range_to = math.hypot(relative[s, 0], relative[s, 1])
        sin_splat, cos_splat = -relative[s, 1] / range_to, relative[s, 0] / range_to
        faintest = 2.0 * math.log(opacity[s] / cutoff) if cutoff > 0.0 else math.inf
        reach = math.sqrt((var[s] + low_pass) * faintest) / focal
        reach = min(1.0, reach * (1.0 + 2.0 * abs(slant) * reach + reach * reach))  # as far as a pinhole stretches it
        angle = math.atan2(sin_splat, cos_splat) + math.pi
        for column in range(math.ceil((angle - reach) / step - 0.5), math.floor((angle + reach) / step - 0.5) + 1):
            p = column % columns
            # the splat is δ to the left of this direction: its offset there, and by how much the pinhole stretches it
            sin = compass[p, 0] * cos_splat - compass[p, 1] * sin_splat
            cos = compass[p, 0] * sin_splat + compass[p, 1] * cos_splat
            ahead = cos + slant * sin
            if range_to * ahead <= hidden:
                continue
            pull = 1.0 / ahead
            away, stretch, own = focal * sin * pull, pull * pull, (slant * cos - sin) * pull
            wide, held = var[s] * stretch * stretch + low_pass, abs(own) > limit
            across = along = 0.0
            if held:  # the Jacobian's ray stops at the limit: the splat's depth shows, and shrinks it
                cos = 1.0 / math.sqrt(1.0 + own * own)
                sin, bound = own * cos, math.copysign(limit, own)
                scale = 1.0 / (1.0 + slant * slant) / cos
                across, along = scale * (cos + bound * sin), scale * (sin - bound * cos)
                wide = across * across * var[s] + 2.0 * across * along * chain[s, 7] + along * along * chain[s, 8]
                wide += low_pass
            if away * away > faintest * wide:
                continue
            by_wide = 1.0 / wide
            raw = opacity[s] * math.exp(-0.5 * away * away * by_wide)
            rho = min(raw, MAX_BLEND)
            left = 1.0 - rho
            for c in range(4):
                gain[p, c] *= left * left
            if counts:
                tint = 0.0
                for c in range(3):
                    tint += (values[s, c] - behind[p, c]) ** 2
                x, y = values[s, 3] - behind[p, 3], values[s, 4] - behind[p, 4]
                active = rho if raw <= MAX_BLEND else 0.0
                by_var = 0.5 * active * (away * by_wide) ** 2
                by_u = active * away * by_wide * stretch
                if held:
                    shape, back = 0.0, -2.0 * by_var * (wide - low_pass) / (range_to * cos)
                    for a in range(3):
                        slope = across * across * chain[s, 4 + a] + 2.0 * across * along * chain[s, 9 + a]
                        shape += worth[s, 2 + a] * (slope + along * along * chain[s, 12 + a]) ** 2
                    by_u -= back * sin * range_to / focal
                    mx = by_u * chain[s, 0] + back * cos * relative[s, 0] / range_to
                    my = by_u * chain[s, 1] + back * cos * relative[s, 1] / range_to
                else:
                    shape, by_var = open_shape, by_var * stretch * stretch
                    by_u += by_var * 4.0 * var[s] * own / focal
                    mx = by_u * chain[s, 0] + by_var * chain[s, 2]
                    my = by_u * chain[s, 1] + by_var * chain[s, 3]
                response = x_worth * mx * mx + y_worth * my * my + by_var * by_var * shape
                response += (active * (1.0 - opacity[s])) ** 2 * worth[s, 5]
                direct, square = rho * by_depth, rho * rho
                sx, sy = x_worth * mx * direct, y_worth * my * direct
                gain[p, 0] += tint * response + square * color_worth
                gain[p, 1] += x * (x * response + 2.0 * sx) + direct * direct * x_worth
                gain[p, 2] += x * (y * response + sy) + y * sx
                gain[p, 3] += y * (y * response + 2.0 * sy) + direct * direct * y_worth
            for c in range(5):
                behind[p, c] += rho * (values[s, c] - behind[p, c])
    return gain
