"""Reference values of closed_forms.txt: exchange areas A_i F_ij of pairs of polygons, to 20 digits.

Run with `python3 closed_forms.py > closed_forms.txt` (needs mpmath). Corners are doubles; every value is that of exactly these
doubles, computed with 60 digits. Two routes:

- contour: 2 pi A_i F_ij = sum over pairs of edges of the integral of ln r dy.dx. The inner integral is elementary; the outer one
  is cut into panels no longer than 3/4 of their distance from the nearest singularity, with 48 Gauss points each.
- sixteen: parallel and perpendicular rectangles with parallel sides in general position as a sum over the sixteen pairs of
  corners (Howell, C-13 and C-15), where the 60 digits outweigh the cancellation.

Pairs of such rectangles go both ways, and the routes must agree to 25 digits. The parts of polygons behind the other's plane
are cut off first. Some pairs are also integrated from point factors (`area_of_point_factors`), which must agree to 15 digits.
"""

import itertools
import sys
from fractions import Fraction

from mpmath import mp, mpf

mp.dps = 60
NODES = None


def gauss(order):
    """Nodes and weights of the Gauss-Legendre rule on [0, 1]."""
    rule = []
    for k in range(order):
        x = mp.cos(mp.pi * (k + mpf(3) / 4) / (order + mpf(1) / 2))
        for _ in range(8):
            p0, p1 = mpf(1), x
            for n in range(2, order + 1):
                p0, p1 = p1, ((2 * n - 1) * x * p1 - (n - 1) * p0) / n
            slope = order * (x * p1 - p0) / (x * x - 1)
            x -= p1 / slope
        rule.append(((1 + x) / 2, 1 / ((1 - x * x) * slope * slope)))
    return rule


# Vectors

def sub(a, b):
    return [x - y for x, y in zip(a, b)]


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def along(a, d, t):
    return [x + y * t for x, y in zip(a, d)]


def unit(a):
    length = mp.sqrt(dot(a, a))
    return [x / length for x in a], length


def edges(loop):
    return list(zip(loop, loop[1:] + loop[:1]))


def normal(loop):
    """Twice the area vector, exact for fractions."""
    total = [0, 0, 0]
    for a, b in zip(loop[1:], loop[2:]):
        total = [x + y for x, y in zip(total, cross(sub(a, loop[0]), sub(b, loop[0])))]
    return total


def area(loop):
    n = normal(loop)
    return mp.sqrt(mpf_of(dot(n, n))) / 2


def mpf_of(x):
    return mpf(x.numerator) / x.denominator if isinstance(x, Fraction) else mpf(x)


def clip(loop, point, n):
    """The part of a loop in front of a plane, exactly."""
    kept = []
    for a, b in edges(loop):
        h_a, h_b = dot(sub(a, point), n), dot(sub(b, point), n)
        if h_a >= 0:
            kept.append(a)
        if h_a * h_b < 0:
            kept.append(along(a, sub(b, a), h_a / (h_a - h_b)))
    return kept if len(kept) >= 3 else None


def facing(i, j):
    """Both loops as exact fractions, cut at each other's planes."""
    i, j = ([[Fraction(x) for x in corner] for corner in loop] for loop in (i, j))
    for loop in (i, j):
        n = normal(loop)
        assert all(dot(sub(corner, loop[0]), n) == 0 for corner in loop), "corners must share a plane exactly"
    return clip(i, j[0], normal(j)), clip(j, i[0], normal(i))


# Route 1: contour integrals

def panels(lo, hi, singular, depth=0):
    """Panels no longer than 3/4 of their distance from the nearest singularity re + i im."""
    length = hi - lo
    distance = min(mp.hypot(max(lo - re, re - hi, 0), im) for re, im in singular)
    if length <= 0.75 * distance or depth > 170:
        return [(lo, hi)]
    mid = (lo + hi) / 2
    return panels(lo, mid, singular, depth + 1) + panels(mid, hi, singular, depth + 1)


def edge_pair(p, q, a, b):
    """The double integral of (ln r + 1) dy.dx over two edges; the 1 cancels around a loop."""
    (d, length), (u, _) = unit(sub(q, p)), unit(sub(b, a))
    c = dot(d, u)
    if abs(c) < mpf(10) ** -50:
        return mpf(0)
    singular = []
    for v in (a, b):
        t = dot(sub(v, p), d)
        rest = sub(sub(v, p), [x * t for x in d])
        singular.append((t, mp.sqrt(dot(rest, rest))))
    n = cross(d, u)
    if dot(n, n) > mpf(10) ** -50:
        t = dot(cross(sub(a, p), u), n) / dot(n, n)
        singular.append((t, abs(dot(sub(a, p), n)) / dot(n, n)))

    def inner(t):
        x = along(p, d, t)
        to_a, to_b = sub(a, x), sub(b, x)
        across = cross(to_a, u)
        h = mp.sqrt(dot(across, across))
        s_a, s_b = dot(to_a, u), dot(to_b, u)
        r2_a, r2_b = dot(to_a, to_a), dot(to_b, to_b)
        value = (s_b * mp.log(r2_b) if r2_b else 0) / 2 - (s_a * mp.log(r2_a) if r2_a else 0) / 2
        return value + (h * (mp.atan2(s_b, h) - mp.atan2(s_a, h)) if h else 0)

    borders = sorted({mpf(0), length, *(re for re, im in singular if 0 < re < length)})
    total = mpf(0)
    for lo, hi in zip(borders, borders[1:]):
        for x, y in panels(lo, hi, singular):
            total += (y - x) * sum(w * inner(x + (y - x) * s) for s, w in NODES)
    return c * total


def contour(i, j):
    i, j = ([[mpf_of(x) for x in corner] for corner in loop] for loop in (i, j))
    pairs = itertools.product(edges(i), edges(j))
    return sum(edge_pair(p, q, a, b) for (p, q), (a, b) in pairs) / (2 * mp.pi)


# Route 2: rectangles with sides along the axes

def span(loop, axis):
    return sorted({corner[axis] for corner in loop})


def sixteen(i, j):
    """Sum over the corners of two rectangles with sides along the axes, or None for other polygons."""
    spans = [[span(loop, axis) for axis in range(3)] for loop in (i, j)]
    if any(len(loop) != 4 for loop in (i, j)) or any(sorted(map(len, s)) != [1, 2, 2] for s in spans):
        return None
    if any(sum(a[k] == b[k] for k in range(3)) != 2 for loop in (i, j) for a, b in edges(loop)):
        return None
    (k_i, k_j) = ([len(s) for s in span3].index(1) for span3 in spans)
    log = lambda r2: mp.log(r2) if r2 else mpf(0)
    arc = lambda x, r: x * r * mp.atan(x / r) if r else mpf(0)
    total = mpf(0)
    if k_i == k_j:
        m, n = (k for k in range(3) if k != k_i)
        z2 = mpf_of(spans[0][k_i][0] - spans[1][k_i][0]) ** 2
        for corner in itertools.product((0, 1), repeat=4):
            u = mpf_of(spans[0][m][corner[0]] - spans[1][m][corner[1]])
            v = mpf_of(spans[0][n][corner[2]] - spans[1][n][corner[3]])
            term = arc(u, mp.sqrt(v * v + z2)) + arc(v, mp.sqrt(u * u + z2)) - z2 * log(u * u + v * v + z2) / 2
            total += (-1) ** sum(corner) * term
    else:
        m = 3 - k_i - k_j
        for corner in itertools.product((0, 1), repeat=4):
            u = mpf_of(spans[0][m][corner[0]] - spans[1][m][corner[1]])
            x = mpf_of(spans[0][k_j][corner[2]] - spans[1][k_j][0])
            y = mpf_of(spans[1][k_i][corner[3]] - spans[0][k_i][0])
            r2 = x * x + y * y
            total += (-1) ** sum(corner) * (arc(u, mp.sqrt(r2)) + (u * u - r2) * log(u * u + r2) / 4)
    return abs(total) / (2 * mp.pi)


# Route 3: point factors

def area_of_point_factors(i, j, order=24):
    """Gauss rule over i (three or four corners) of the exact point factor of j: for separated pairs."""
    n, _ = unit([mpf_of(x) for x in normal(i)])
    i, j = ([[mpf_of(x) for x in corner] for corner in loop] for loop in (i, j))
    a, b, c, d = i if len(i) == 4 else i + i[:1]
    rule, total = gauss(order), mpf(0)
    for (s, w_s), (t, w_t) in itertools.product(rule, rule):
        mix = lambda k: (1 - s) * ((1 - t) * a[k] + t * d[k]) + s * ((1 - t) * b[k] + t * c[k])
        x = [mix(k) for k in range(3)]
        x_s = [(1 - t) * (b[k] - a[k]) + t * (c[k] - d[k]) for k in range(3)]
        x_t = [(1 - s) * (d[k] - a[k]) + s * (c[k] - b[k]) for k in range(3)]
        jacobian = dot(n, cross(x_s, x_t))
        factor = mpf(0)
        for v, w in edges([sub(corner, x) for corner in j]):
            e = cross(w, v)
            sine = mp.sqrt(dot(e, e))
            factor += dot(n, e) / sine * mp.atan2(sine, dot(v, w))
        total += w_s * w_t * jacobian * factor
    return total / (2 * mp.pi)


# Configurations

def floor(a=1.0, b=1.0, x=0.0, y=0.0, z=0.0):
    """a x b at (x, y, z), facing up."""
    return [(x, y, z), (x + a, y, z), (x + a, y + b, z), (x, y + b, z)]


def ceiling(z, a=1.0, b=1.0, x=0.0, y=0.0):
    return floor(a, b, x, y, z)[::-1]


def wall(b=1.0, h=1.0, y=0.0, x=0.0, z=0.0):
    """b x h in the plane of x, facing +x."""
    return [(x, y, z), (x, y + b, z), (x, y + b, z + h), (x, y, z + h)]


def hinged(degrees, a=1.0):
    """Unit square turned up from the floor about the x axis."""
    angle = mp.radians(mpf(degrees))
    c, s = float(mp.cos(angle)), float(mp.sin(angle))
    if degrees == 90:
        c = 0.0
    return [(0.0, 0.0, 0.0), (0.0, c, s), (a, c, s), (a, 0.0, 0.0)]


def moved(loop, by):
    return [tuple(x + y for x, y in zip(corner, by)) for corner in loop]


def configurations():
    one = floor()
    for gap in (1e-6, 1e-4, 0.01, 0.1, 1.0, 10.0, 100.0, 1e4):
        yield f"opposed squares, gap {gap:g}", one, ceiling(gap)
    for gap in (1e-6, 1e-4, 0.01, 1.0, 100.0, 1e4):
        yield f"shifted squares, gap {gap:g}", one, ceiling(gap, x=0.37, y=0.11)
    for gap in (1e-6, 1e-4, 0.01):
        yield f"squares one side aside, gap {gap:g}", one, ceiling(gap, x=1.0)
    yield "squares far aside, gap 0.01", one, ceiling(0.01, x=3.0, y=0.5)
    yield "opposed 3 x 5", floor(3.0, 5.0), ceiling(2.0, 3.0, 5.0)
    yield "opposed 1 x 1000", floor(1.0, 1000.0), ceiling(0.5, 1.0, 1000.0)
    yield "small over large", floor(0.25, 0.25, 0.25, 0.5), ceiling(0.125)

    for h in (1.0, 0.1, 1e-3, 1e-5):
        yield f"wall 1 x {h:g} on an edge", one, wall(1.0, h)
    for h in (1.0, 1e-5):
        for gap in (1e-6, 0.01, 0.5):
            yield f"wall 1 x {h:g} at {gap:g} beside", one, wall(1.0, h, x=-gap)
            yield f"wall 1 x {h:g} at {gap:g} above", one, wall(1.0, h, z=gap)
    yield "wall 3 x 4 on 2 x 4", floor(2.0, 4.0), wall(4.0, 3.0)
    yield "wall on a part of an edge", one, wall(0.5, 1.0, y=0.25)
    yield "wall past a corner", one, wall(1.0, 1.0, y=0.5)
    yield "wall from a corner on", one, wall(1.0, 1.0, y=1.0)
    yield "wall off a corner by 1e-6", one, wall(1.0, 1.0, y=1.000001)
    yield "wall across the middle", one, wall(1.0, 1.0, x=0.5)

    thin = 1e-7
    yield "opposed slivers, gap 1", floor(1.0, thin), ceiling(1.0, 1.0, thin)
    yield "opposed slivers, gap 0.01", floor(1.0, thin), ceiling(0.01, 1.0, thin)
    yield "opposed slivers, gap 1e-7", floor(1.0, thin), ceiling(thin, 1.0, thin)
    yield "crossed slivers, gap 0.01", floor(1.0, thin, 0.0, 0.3), ceiling(0.01, thin, 1.0, x=0.4)
    yield "sliver over a square, gap 0.1", floor(1.0, thin, 0.0, 0.3), ceiling(0.1)
    yield "sliver over the edge of a square, gap 1e-4", floor(1.0, thin), ceiling(1e-4)
    yield "sliver hinged to a square", one, wall(1.0, thin)
    yield "slivers hinged on the long side", floor(thin, 1.0), wall(1.0, thin)
    yield "slivers hinged on the short side", floor(1.0, thin), wall(thin, 1.0)
    yield "upright sliver on an edge", one, wall(thin, 1.0, y=0.5)
    yield "sliver wall at 0.1 beside a square", one, wall(1.0, thin, x=-0.1)
    yield "sliver wall at 1e-7 beside a sliver", floor(thin, 1.0), wall(1.0, thin, x=-thin)
    yield "sliver triangle hinged to a square", one, [(0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (thin, 0.25, thin)]
    yield "turned sliver over a square", one, [(0.1, 0.2, 0.3), (0.1 + thin, 0.2, 0.3 - thin), (0.7, 0.9, 0.5)]

    for degrees in (1, 5, 30, 60, 90, 120, 150, 175, 179):
        yield f"squares hinged at {degrees} degrees", one, hinged(degrees)
    yield "rectangles hinged at 30 degrees, the second longer", one, hinged(30, 2.0)

    yield "shared corner, triangle", one, [(2.0, 1.0, 1.0), (1.0, 2.0, 1.0), (1.0, 1.0, 0.0)]
    yield "shared corner, steep square", one, [(1.0, 1.0, 0.0), (2.0, 2.0, 0.0), (2.0, 2.0, 1.0), (1.0, 1.0, 1.0)][::-1]
    yield "shared corner, flat triangle", one, [(1.0, 1.0, 0.0), (2.0, 1.5, 0.01), (1.5, 2.0, 0.01)]
    yield "shared corner, low over the face", one, [(1.0, 1.0, 0.0), (0.0, 0.75, 0.125), (0.75, 0.0, 0.125)][::-1]
    yield "shared corner, small triangle", one, [(1.001, 1.0, 0.001), (1.0, 1.001, 0.001), (1.0, 1.0, 0.0)]
    yield "corner on an edge", one, [(0.9, 1.4, 1.0), (0.2, 1.5, 1.0), (0.4, 1.0, 0.0)]
    yield "corner on the face", one, [(0.4, 0.6, 0.0), (0.9, 0.3, 0.5), (0.5, 0.2, 0.7)]
    yield "corner 1e-6 above the face", one, [(0.2, 0.2, 1e-6), (0.3, 0.9, 0.002), (0.8, 0.3, 0.001)]
    yield "corner near an edge", one, [(1.3, 2.0, 1.0), (0.2, 2.0, 1.0), (0.5, 1.001, 0.0)]

    tetrahedron = [(1.0, 1.0, 1.0), (1.0, -1.0, -1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, 1.0)]
    a, b, c, d = tetrahedron
    yield "faces of a tetrahedron", [a, c, b], [a, b, d]
    yield "skew triangle over a square", one, [(0.3, 0.2, 1.0), (0.2, 1.3, 1.4), (1.5, 1.2, 1.8)]
    yield "triangle low over a square", one, [(0.3, 0.2, 0.1), (0.2, 0.9, 0.15), (0.8, 0.7, 0.2)]
    yield "triangle through the plane of a square", one, [(0.0, 1.0, 1.0), (1.0, 0.0, 1.0), (0.25, 0.25, -0.25)]
    yield "wall through the floor", one, wall(1.0, 3.0, z=-2.0)
    yield "each through the other's plane", floor(4.0, 1.0, -3.0), wall(1.0, 3.0, z=-2.0)
    yield "triangles through each other", [(0.0, 0.0, 0.0), (2.0, 0.0, 0.5), (0.5, 2.0, 0.25)], \
        [(0.5, 0.5, -1.0), (0.75, 1.5, 1.0), (0.25, 0.25, 1.5)]

    tiny = 1e-6
    yield "ratio 1e6, in front", floor(tiny, tiny, 0.3, 0.6), ceiling(1.0)
    yield "ratio 1e6, close in front", floor(tiny, tiny, 0.3, 0.6), ceiling(1e-5)
    yield "ratio 1e6, below a corner", floor(tiny, tiny), ceiling(1e-6)
    yield "ratio 1e6, upright on an edge", one, wall(tiny, tiny, y=0.5)
    yield "ratio 1e6, upright on a corner", one, wall(tiny, tiny)
    yield "ratio 1e6, beside a corner", one, wall(tiny, tiny, y=1.0)
    yield "ratio 1e6, upright on the face", one, wall(tiny, tiny, y=0.5, x=0.5)
    yield "ratio 1e6, triangle on the face", one, \
        [(0.5, 0.5, 0.0), (0.500001, 0.5000005, 1e-6), (0.5000003, 0.500001, 5e-7)]
    yield "ratio 1e6, triangle at a corner", one, \
        [(1.0, 1.0, 0.0), (1.000001, 1.0, 1e-6), (1.0, 1.000001, 5e-7)]
    yield "ratio 1e4, triangle at an edge", one, \
        [(0.5, 1.0, 0.0), (0.5001, 1.0, 0.0), (0.5, 1.0001, 0.0001)]

    away = (1e5, -1e5, 1e5)
    yield "opposed squares at 1e5", moved(one, away), moved(ceiling(1.0), away)
    yield "opposed squares at 1e5, gap 1e-4", moved(one, away), moved(ceiling(1e-4, x=0.37), away)
    yield "opposed squares at 1e5, gap 100", moved(one, away), moved(ceiling(100.0, x=0.3), away)
    yield "wall at 1e5", moved(one, away), moved(wall(0.9, 0.7), away)
    yield "wall 1 x 1e-5 at 1e5", moved(one, away), moved(wall(1.0, 1e-5), away)
    yield "triangles at 1e5", moved([(0.1, 0.2, 0.0), (1.1, 0.3, 0.1), (0.4, 1.2, 0.3)], away), \
        moved([(0.3, 0.2, 1.0), (0.2, 1.3, 1.4), (1.5, 1.2, 1.8)], away)
    yield "shared corner at 1e5", moved(one, away), moved([(2.0, 1.3, 1.1), (1.1, 2.0, 1.0), (1.0, 1.0, 0.0)], away)

    first, second, third = (0.1, 0.2, 0.3), (1.1, 0.3, 0.4), (0.4, 1.2, 0.7)
    yield "through each other at an angle of 1e-6", [first, second, third], \
        [(0.4, 1.2, 0.700001), (1.1, 0.3, 0.3999995), (0.1, 0.2, 0.3000002)]
    yield "sliver triangle, part of an edge in common", [first, second, (0.6, 0.25001, 0.35)], \
        [second, (0.6, 0.25, 0.35), (0.9, 1.1, 1.3)]
    yield "slivers in general position, corner in common", [first, second, (0.7, 0.26001, 0.36)], \
        [(0.2, 0.65001, 0.6), (0.3, 1.1, 0.9), first]
    yield "small triangle, corner in common", [first, second, third], \
        [(0.1, 0.20001, 0.30001), (0.10001, 0.20001, 0.30002), first]


def main():
    global NODES
    NODES = gauss(48)
    print("# name | corners of i | corners of j | A_i F_ij; made by closed_forms.py")
    for name, first, second in configurations():
        i, j = facing(first, second)
        value, how = contour(i, j), "contour"
        other = sixteen(i, j)
        if other is not None:
            assert abs(other - value) <= mpf(10) ** -25 * value, (name, value, other)
            how = "contour, sixteen"
        if name in ("skew triangle over a square", "wall 1 x 1 at 0.5 beside", "opposed squares, gap 1"):
            other = area_of_point_factors(i, j)
            assert abs(other - value) <= mpf(10) ** -15 * value, (name, value, other)
            how += ", point factors"
        loops = [", ".join(" ".join(map(repr, corner)) for corner in loop) for loop in (first, second)]
        print(name, *loops, mp.nstr(value, 20, min_fixed=0, max_fixed=0), sep=" | ", flush=True)
        smaller = min(area([[Fraction(x) for x in corner] for corner in loop]) for loop in (first, second))
        print(name, how, mp.nstr(value / smaller, 8), file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
