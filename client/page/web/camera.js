// Where one looks from. Places are lattice numbers relative to the middle of the mesh, as in the surface; the scene is in units of
// length, with heights times `exaggeration`.

const VIEW_ANGLE = 32 * Math.PI / 180;
const LEAST_PITCH = 4 * Math.PI / 180;

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

class Camera {
	// `step`: the length of a lattice step of each axis.
	constructor(surface, step) {
		this.surface = surface;
		this.step = step;
		this.exaggeration = 1;
		this.width = this.height = 1;
		this.covered = [0, 0]; // pixels on the left and on the right that other things lie over
		this.reset();
	}

	size(axis) {
		return (this.surface.high[axis] - this.surface.low[axis]) * this.steps()[axis];
	}

	steps() {
		return [this.step[0], this.step[1], this.step[2] * this.exaggeration];
	}

	// The whole mesh, from the south-west.
	reset() {
		this.yaw = -0.45;
		this.pitch = 0.82;
		this.parallel = false;
		this.fit();
	}

	// The whole mesh, from above, north up, as a map.
	top() {
		this.yaw = 0;
		this.pitch = Math.PI / 2;
		this.parallel = true;
		this.fit();
	}

	fit() {
		const low = this.surface.low, high = this.surface.high;

		this.target = [0, 1, 2].map(axis => (low[axis] + high[axis]) / 2);
		// As far as it takes to have all corners of the box in the picture.
		this.distance = this.farthest = this.radius() / Math.sin(VIEW_ANGLE / 2) || 1;
		for (let i = 0; i < 20; i++) {
			const size = this.extent();
			this.distance *= Math.min(1.25, Math.max(0.5, size / 0.92));
		}
		this.pan((this.covered[0] - this.covered[1]) / 2, 0);
		this.farthest = Math.max(this.farthest, this.distance) * 3;
		this.fitted = true; // and not moved since
	}

	// How much of half the picture the box takes, at most.
	extent() {
		const wide = this.width - this.covered[0] - this.covered[1];
		let most = 0;

		for (let i = 0; i < 8; i++) {
			const at = [0, 1, 2].map(axis => (i >> axis & 1 ? this.surface.high : this.surface.low)[axis]), p = this.project(at);
			most = Math.max(most, p ? Math.abs(2 * p[0] - this.width) / wide : 2, p ? Math.abs(2 * p[1] / this.height - 1) : 2);
		}
		return most;
	}

	radius() {
		return Math.hypot(this.size(0), this.size(1), this.size(2)) / 2;
	}

	// Right, up and towards the eye.
	axes() {
		const cy = Math.cos(this.yaw), sy = Math.sin(this.yaw), cp = Math.cos(this.pitch), sp = Math.sin(this.pitch);

		return [[cy, sy, 0], [-sp * sy, sp * cy, cp], [sy * cp, -cy * cp, sp]];
	}

	// Half the height of the picture at the target.
	half() {
		return this.distance * Math.tan(VIEW_ANGLE / 2);
	}

	// Length of a pixel at the target.
	pixel() {
		return 2 * this.half() / this.height;
	}

	// Column-major; for places relative to `origin` (a place), in units of length.
	matrix(origin) {
		const [x, y, z] = this.axes(), steps = this.steps(), m = new Float32Array(16);
		const off = origin.map((n, axis) => (this.target[axis] - n) * steps[axis]);
		const eye = off.map((n, axis) => n + z[axis] * this.distance);
		const [near, far] = this.depths(z);
		const sy = 1 / (this.parallel ? this.half() : Math.tan(VIEW_ANGLE / 2)), sx = sy * this.height / this.width;

		for (let c = 0; c < 3; c++) {
			m[4 * c] = sx * x[c];
			m[4 * c + 1] = sy * y[c];
			m[4 * c + 2] = z[c] * (this.parallel ? -2 / (far - near) : (far + near) / (near - far));
			m[4 * c + 3] = this.parallel ? 0 : -z[c];
		}
		m[12] = -sx * dot(x, eye);
		m[13] = -sy * dot(y, eye);
		if (this.parallel) {
			m[14] = 2 * dot(z, eye) / (far - near) - (far + near) / (far - near);
			m[15] = 1;
		} else {
			m[14] = -dot(z, eye) * (far + near) / (near - far) + 2 * far * near / (near - far);
			m[15] = dot(z, eye);
		}
		return m;
	}

	// Nearest and farthest of the mesh along the view.
	depths(z) {
		const steps = this.steps(), away = this.target.map((n, axis) => n * steps[axis]);
		const middle = this.distance + dot(z, away), radius = this.radius() * 1.01 + 1e-9;

		if (this.parallel)
			return [middle - radius, middle + radius];
		const near = Math.max(this.distance / 100, middle - radius);
		return [near, Math.max(near * 1.01, middle + radius)];
	}

	// A place to pixels of the page: [x, y]; null behind the eye.
	project(place) {
		const [x, y, z] = this.axes(), steps = this.steps();
		const d = place.map((n, axis) => (n - this.target[axis]) * steps[axis]);
		const depth = this.distance - dot(z, d), scale = this.height / 2 / (this.parallel ? this.half() : Math.tan(VIEW_ANGLE / 2) * depth);

		if (!this.parallel && depth <= 0)
			return null;
		return [this.width / 2 + dot(x, d) * scale, this.height / 2 - dot(y, d) * scale];
	}

	// The ray through a pixel: [from, along], places.
	ray(px, py) {
		const [x, y, z] = this.axes(), steps = this.steps(), k = Math.tan(VIEW_ANGLE / 2) * 2 / this.height;
		const u = (px - this.width / 2) * k, v = (this.height / 2 - py) * k, d = this.distance;
		const place = f => [0, 1, 2].map(axis => f(axis) / steps[axis]);

		if (this.parallel) {
			const back = d + 4 * this.radius();
			const from = place(a => x[a] * u * d + y[a] * v * d + z[a] * back);
			return [from.map((n, axis) => n + this.target[axis]), place(a => -z[a] * back)];
		}
		return [place(a => z[a] * d).map((n, axis) => n + this.target[axis]), place(a => (x[a] * u + y[a] * v - z[a]) * d)];
	}

	// ---- movements ----

	turn(dx, dy) {
		this.fitted = false;
		this.yaw -= dx * 0.006;
		this.pitch = Math.min(Math.PI / 2, Math.max(LEAST_PITCH, this.pitch + dy * 0.006));
		if (dy)
			this.parallel = false;
	}

	// The ground follows the pointer.
	pan(dx, dy) {
		const k = this.pixel(), sy = Math.sin(this.yaw), cy = Math.cos(this.yaw), far = 1 / Math.max(0.3, Math.sin(this.pitch));

		this.fitted = false;
		this.target[0] -= (dx * cy + dy * sy * far) * k / this.step[0];
		this.target[1] -= (dx * sy - dy * cy * far) * k / this.step[1];
		for (let axis = 0; axis < 2; axis++)
			this.target[axis] = Math.min(this.surface.high[axis], Math.max(this.surface.low[axis], this.target[axis]));
	}

	// Times `factor`, towards a place that stays where it is on the screen.
	zoom(factor, place) {
		const least = Math.max(this.step[0] * 20, this.radius() * 1e-6), to = Math.min(this.farthest, Math.max(least, this.distance * factor));
		const part = to / this.distance;

		if (place)
			this.target = this.target.map((n, axis) => place[axis] + (n - place[axis]) * part);
		this.distance = to;
		this.fitted = false;
	}

	// Turns are about what is in the middle of the picture: the target moves there, and the picture stays.
	refocus() {
		const [from, along] = this.ray(this.width / 2, this.height / 2), hit = this.surface.hit(from, along), steps = this.steps();

		if (!hit)
			return;
		if (!this.parallel)
			this.distance = Math.hypot(...[0, 1, 2].map(axis => (hit[axis] - from[axis]) * steps[axis]));
		this.target = hit;
	}
}
