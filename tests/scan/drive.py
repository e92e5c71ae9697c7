"""A simulated survey: a vehicle with a scanner on a road over analytic terrain, its poses and its spool; and the expected place
of each shot, by formulas that share nothing with acut's: rotation vectors instead of quaternions, Krueger's series instead of
GeographicLib."""
import math
import os
import struct
import subprocess

import e2e

SCAN = os.environ.get("ACUT_SCAN", "acut-scan")
WRITE = os.environ.get("SPOOL_WRITE", "spool-write")
START = 1700000000.0  # UTC at monotonic time 0
DATA, EVENT, CLOCK = 1, 2, 3

PROFILE = """title = A scanner of the tests
[framer]
kind = fixed
size = %(size)d
sync = \\xa5\\x5a
[decoder]
name = ranges
range = u32le@8
range-scale = 1e-5
range-least = 1
shots = %(shots)d
counter = u32le@4
angle-first = %(first)r
angle-step = %(step)r
period = %(period)r
[geometry]
mount-roll = %(roll)r
mount-pitch = %(pitch)r
mount-heading = %(heading)r
lever-x = %(x)r
lever-y = %(y)r
lever-z = %(z)r
range-min = 0.5
range-max = 60
"""
SENSOR = dict(shots=90, first=-60.0, step=120 / 89.0, period=0.04, roll=2.0, pitch=-80.0, heading=4.0, x=0.6, y=-0.25, z=-1.8)


# ---- matrices, three by three, rows ----

def mul(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def turn(m, v):
    return [sum(m[i][k] * v[k] for k in range(3)) for i in range(3)]


def flip(m):
    return [list(row) for row in zip(*m)]


def attitude(roll, pitch, heading):
    """The rotation from the body (ahead, right, down) to north, east, down."""
    r, p, h = (math.radians(a) for a in (roll, pitch, heading))
    rx = [[1, 0, 0], [0, math.cos(r), -math.sin(r)], [0, math.sin(r), math.cos(r)]]
    ry = [[math.cos(p), 0, math.sin(p)], [0, 1, 0], [-math.sin(p), 0, math.cos(p)]]
    rz = [[math.cos(h), -math.sin(h), 0], [math.sin(h), math.cos(h), 0], [0, 0, 1]]
    return mul(rz, mul(ry, rx))


def between(a, b, t):
    """The rotation from a to b, about one axis (Rodrigues)."""
    d = mul(flip(a), b)
    c = max(-1.0, min(1.0, (d[0][0] + d[1][1] + d[2][2] - 1) / 2))
    axis = [d[2][1] - d[1][2], d[0][2] - d[2][0], d[1][0] - d[0][1]]
    n = math.hypot(*axis)
    angle = math.atan2(n / 2, c)
    if n < 1e-15:
        return a
    x, y, z = (v / n for v in axis)
    s, c = math.sin(angle * t), 1 - math.cos(angle * t)
    k = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    kk = mul(k, k)
    return mul(a, [[(i == j) + s * k[i][j] + c * kk[i][j] for j in range(3)] for i in range(3)])


# ---- transverse Mercator, after Krueger (1912) in the form of Karney (2011), order 6; also the convergence ----

def utm(lat, lon, zone):
    a, f, k0 = 6378137.0, 1 / 298.257223563, 0.9996
    n = f / (2 - f)
    e = math.sqrt(f * (2 - f))
    alpha = [
        n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16 + 41 * n**4 / 180 - 127 * n**5 / 288 + 7891 * n**6 / 37800,
        13 * n**2 / 48 - 3 * n**3 / 5 + 557 * n**4 / 1440 + 281 * n**5 / 630 - 1983433 * n**6 / 1935360,
        61 * n**3 / 240 - 103 * n**4 / 140 + 15061 * n**5 / 26880 + 167603 * n**6 / 181440,
        49561 * n**4 / 161280 - 179 * n**5 / 168 + 6601661 * n**6 / 7257600,
        34729 * n**5 / 80640 - 3418889 * n**6 / 1995840,
        212378941 * n**6 / 319334400]
    radius = a / (1 + n) * (1 + n**2 / 4 + n**4 / 64 + n**6 / 256)
    phi, lam = math.radians(lat), math.radians(lon - (6 * zone - 183))
    tau = math.tan(phi)
    sigma = math.sinh(e * math.atanh(e * tau / math.hypot(1, tau)))
    conformal = tau * math.hypot(1, sigma) - sigma * math.hypot(1, tau)
    xi, eta = math.atan2(conformal, math.cos(lam)), math.asinh(math.sin(lam) / math.hypot(conformal, math.cos(lam)))
    x = eta + sum(c * math.cos(2 * (j + 1) * xi) * math.sinh(2 * (j + 1) * eta) for j, c in enumerate(alpha))
    y = xi + sum(c * math.sin(2 * (j + 1) * xi) * math.cosh(2 * (j + 1) * eta) for j, c in enumerate(alpha))
    p = 1 + sum(2 * (j + 1) * c * math.cos(2 * (j + 1) * xi) * math.cosh(2 * (j + 1) * eta) for j, c in enumerate(alpha))
    q = sum(2 * (j + 1) * c * math.sin(2 * (j + 1) * xi) * math.sinh(2 * (j + 1) * eta) for j, c in enumerate(alpha))
    gamma = math.atan(conformal / math.hypot(1, conformal) * math.tan(lam)) + math.atan2(q, p)
    return 500000 + k0 * radius * x, (0 if lat >= 0 else 10000000) + k0 * radius * y, math.degrees(gamma)


# ---- the drive ----

def terrain(x, y):
    return 300 + 0.02 * (x - 500000) + 1.5 * math.sin(x / 9) * math.cos(y / 7)


class Drive:
    """Poses at `hz`, in a plane, or (lat, lon given) in degrees about there, with headings from true north."""

    def __init__(self, seconds=4.0, hz=50, where=None, seed=0, start=START):
        self.seconds, self.where, self.poses = seconds, where, []
        for i in range(int(seconds * hz) + 1):
            t = i / hz
            pose = [start + t, 500000 + 7 * t + 30 * seed, 5400000 + 6 * math.sin(t / 3 + seed), 305 + 0.1 * math.sin(2 * t),
                    5 * math.sin(1.3 * t + seed), 3 * math.sin(0.9 * t), (358 + 9 * math.sin(t) + 80 * seed) % 360]
            if where:
                pose[1:3] = [where[0] + 4e-5 * t, where[1] + 6e-5 * math.sin(t / 2)]
            # the poses are rounded as in the file
            digits = (6, 10, 10, 4, 6, 6, 6) if where else (6, 4, 4, 4, 6, 6, 6)
            self.poses.append([round(v, d) for v, d in zip(pose, digits)])

    def csv(self, path, **how):
        names = "time,latitude,longitude,ellipsoidal_height,roll,pitch,heading" if self.where else \
            "time,easting,northing,height,roll,pitch,heading"
        shift = how.get("shift", 0)
        with open(path, "w", newline="") as f:
            f.write(names + how.get("end", "\n"))
            for p in self.poses:
                p = list(p)
                p[3] += shift
                f.write(",".join(repr(v) for v in p) + how.get("end", "\n"))
        return path

    def at(self, t, zone=None, limit=1.5):
        """Position in the plane and body to north-east-down of the grid; None where there is no pose."""
        lo, hi = 0, len(self.poses) - 1
        if not self.poses[0][0] <= t <= self.poses[-1][0]:
            return None
        while hi - lo > 1:
            m = (lo + hi) // 2
            lo, hi = (m, hi) if self.poses[m][0] <= t else (lo, m)
        a, b = self.poses[lo], self.poses[hi]
        if b[0] - a[0] > limit and t not in (a[0], b[0]):
            return None
        u = (t - a[0]) / (b[0] - a[0])
        (pa, ra), (pb, rb) = self.placed(a, zone), self.placed(b, zone)
        return [x + (y - x) * u for x, y in zip(pa, pb)], between(ra, rb, u)

    def placed(self, p, zone):
        if not self.where:
            return p[1:4], attitude(*p[4:7])
        x, y, gamma = utm(p[1], p[2], zone)
        return [x, y, p[3]], attitude(p[4], p[5], p[6] - gamma)


def profile_text(**changes):
    s = dict(SENSOR, **changes)
    return PROFILE % dict(s, size=8 + 4 * s["shots"])


MOUNT = attitude(SENSOR["roll"], SENSOR["pitch"], SENSOR["heading"])


def land(pose, angle, distance, s=SENSOR):
    """The place of a shot; the sensor looks ahead at angle 0, to the left at 90."""
    at, ned = pose
    mount = MOUNT
    ray = turn(mount, [math.cos(angle), -math.sin(angle), 0])
    north, east, down = turn(ned, [lever + distance * r for lever, r in zip((s["x"], s["y"], s["z"]), ray)])
    return [at[0] + east, at[1] + north, at[2] - down]


class Survey:
    """Sweeps of a drive: ranges to the terrain as raw numbers, and the point of each shot that has a pose."""

    def __init__(self, drive, sweeps, zone=None, first=0.05, flat=None):
        s = SENSOR
        self.records, self.points, self.shots, self.without = [], [], 0, 0
        duration = (s["shots"] - 1) * s["step"] / 360 * s["period"]
        for k in range(sweeps):
            start = first + k * s["period"]
            raws = []
            for i in range(s["shots"]):
                angle = math.radians(s["first"] + i * s["step"])
                t = START + start + i * s["step"] / 360 * s["period"]
                pose = drive.at(t, zone)
                distance = self.reach(pose, angle, flat)
                raw = int(round(distance * 1e5)) if 0.5 <= distance <= 60 else 0
                raws.append(raw)
                self.shots += 1
                if raw and pose:
                    self.points.append(land(pose, angle, raw * 1e-5))
                elif raw:
                    self.without += 1
            body = b"\xa5\x5a\0\0" + struct.pack("<I", k + 1) + struct.pack("<%dI" % len(raws), *raws)
            # the transfer that begins the telegram came with the last shot
            self.records.append((DATA, int(round((start + duration) * 1e9)) + 1, body))

    @staticmethod
    def reach(pose, angle, flat):
        """Distance along the ray to the terrain (bisection)."""
        if not pose:
            return 7.0
        lo, hi = 0.0, 60.0
        p, q = land(pose, angle, 0), land(pose, angle, 1)
        v = [b - a for a, b in zip(p, q)]
        if flat is not None:
            return (flat - p[2]) / v[2]
        height = lambda d: p[2] + d * v[2] - terrain(p[0] + d * v[0], p[1] + d * v[1])
        if height(hi) > 0 or height(lo) < 0:
            return 0.0
        for _ in range(32):
            m = (lo + hi) / 2
            lo, hi = (m, hi) if height(m) > 0 else (lo, m)
        return hi


def spool(path, records, profile=None, ident="00112233445566778899aabbccddeeff", utc=START, *more):
    conf = path + ".conf"
    with open(conf, "w") as f:
        f.write(profile or profile_text())
    text = b"".join(struct.pack("<BqI", kind, time, len(body)) + body for kind, time, body in records)
    p = subprocess.run([WRITE, path, conf, ident, str(int(utc * 1e9)), *more], input=text, stderr=subprocess.PIPE)
    e2e.expect(p.returncode == 0, p.stderr.decode())
    return path


def read_las(path):
    """Points, as integers of the scale, and the header's numbers."""
    with open(path, "rb") as f:
        d = f.read()
    at, fmt, length = struct.unpack_from("<I", d, 96)[0], d[104], struct.unpack_from("<H", d, 105)[0]
    scale, offset = struct.unpack_from("<3d", d, 131), struct.unpack_from("<3d", d, 155)
    count = struct.unpack_from("<Q", d, 247)[0]
    e2e.expect(d[:4] == b"LASF" and d[24:26] == b"\1\4" and fmt == 6 and length == 30, "no LAS 1.4 of format 6")
    e2e.expect(len(d) == at + count * length, "%d bytes for %d points" % (len(d), count))
    points = [[offset[i] + n * scale[i] for i, n in enumerate(struct.unpack_from("<3i", d, at + k * length))] for k in range(count)]
    times = [struct.unpack_from("<d", d, at + k * length + 22)[0] for k in range(count)]
    return points, times, d


def scan(*args, socket=None, **kw):
    return e2e.run([SCAN, *args, *(["--socket", socket] if socket else [])], **kw)
