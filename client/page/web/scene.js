// The picture of the surface, by WebGL 2.
//
// The graphics processor gets the lattice numbers as they are. The shader subtracts a whole number near the middle of the view
// before it makes floats of them: where one looks closely, nothing is lost. Each triangle is shaded by its own plane.

const VERTEX = `#version 300 es
in ivec3 number;
uniform ivec3 origin;    // lattice number near the target
uniform vec3 step;       // length of a lattice step
uniform float exaggeration;
uniform mat4 camera;
uniform int skirt;       // vertices from this number on hang down by drop
uniform float drop;
uniform vec3 behind;     // what is coarse is drawn where it is, but yields to all that is nearer than this far behind it
out highp vec3 place;    // relative to the origin, in units of length
void main() {
	place = vec3(number - origin) * step;
	if (gl_VertexID >= skirt)
		place.z -= drop;
	vec3 at = vec3(place.xy, place.z * exaggeration);
	gl_Position = camera * vec4(at, 1.0);
	vec4 far = camera * vec4(at + behind, 1.0);
	if (gl_Position.w > 0.0 && far.w > 0.0)
		gl_Position.z = far.z / far.w * gl_Position.w;
}`;

const SURFACE = `#version 300 es
precision highp float;
precision highp int;
in highp vec3 place;
uniform int mode;             // 0 hillshade, 1 elevation, 2 slope, 3 domains
uniform vec3 ramp[${RAMP}];
uniform vec2 range;           // heights at both ends of the ramp, relative to the origin
uniform vec3 domain;
uniform float exaggeration;
uniform vec2 contour;         // contours: 1 / interval, of heights relative to the origin; of every fifth one
uniform vec2 phase;           // what the origin's height is above a contour, in intervals; above a fifth one
uniform float thick;          // pixels of a line
out vec4 colour;

vec3 along(float t) {
	t = clamp(t, 0.0, 1.0) * float(${RAMP - 1});
	int i = min(int(t), ${RAMP - 2});
	return mix(ramp[i], ramp[i + 1], t - float(i));
}

// How much of the pixel a contour covers. Level ground has none, at whatever height.
float line(float levels, float wide) {
	float change = length(vec2(dFdx(levels), dFdy(levels)));
	float away = abs(fract(levels + 0.5) - 0.5) / change;
	float seen = 1.0 - smoothstep(wide * 0.5 - 0.5, wide * 0.5 + 0.5, away);
	return change > 4e-7 * (abs(levels) + 1.0) ? seen * (1.0 - smoothstep(0.2, 0.45, change)) : 0.0;
}

void main() {
	vec3 normal = cross(dFdx(place), dFdy(place));
	normal = normalize(normal.z < 0.0 ? -normal : normal);
	vec3 seen = normalize(vec3(normal.xy * exaggeration, normal.z));
	// Lambert's law, the light in the north-west and 45 degrees high; level ground is 1.
	float light = max(0.0, dot(seen, vec3(-0.5, 0.5, 0.70710678))) / 0.70710678;
	vec3 c;
	if (mode == 0)
		c = vec3(0.80, 0.79, 0.77) * (0.12 + 0.88 * light);
	else if (mode == 1)
		c = along((place.z - range.x) / (range.y - range.x));
	else if (mode == 2)
		c = along(degrees(acos(clamp(normal.z, 0.0, 1.0))) / ${STEEPEST}.0);
	else
		c = domain;
	if (mode == 1 || mode == 3)
		c *= min(1.12, 0.42 + 0.58 * light);
	else if (mode == 2)
		c *= min(1.0, 0.8 + 0.2 * light);
	if (contour.x > 0.0) {
		float fine = line(place.z * contour.x + phase.x, thick), fifth = line(place.z * contour.y + phase.y, thick * 2.0);
		vec3 ink = dot(c, vec3(0.3, 0.6, 0.1)) > 0.36 ? vec3(0.20, 0.11, 0.04) : vec3(1.0, 0.95, 0.85);
		c = mix(c, ink, max(0.62 * fine, 0.9 * fifth));
	}
	colour = vec4(c, 1.0);
}`;

const WIRE = `#version 300 es
precision highp float;
in highp vec3 place;
uniform vec4 ink;
out vec4 colour;
void main() {
	colour = ink + 0.0 * place.x;
}`;

// Vertices and triangles that are drawn together. `skirt`: the first vertex of their skirts.
class Part {
	constructor(mesh) {
		this.mesh = mesh;
		this.skirt = mesh.skirt || 2 ** 31 - 1;
		this.made = 0; // for which graphics processor
	}
}

class Scene {
	constructor(canvas, surface, step) {
		const gl = canvas.getContext("webgl2", {antialias: true, alpha: true});

		if (!gl)
			throw new Missing("WebGL 2");
		Object.assign(this, {canvas, gl, surface, step, made: 0});
		// Whole numbers of 32 bits tell places apart up to 2^31 steps; larger meshes are drawn at half of the steps.
		this.halve = surface.high.some((n, axis) => n - surface.low[axis] > 2 ** 31 - 2) ? 2 : 1;
		this.state = {mode: 1, interval: 0, wire: false, range: [0, 1]};
		this.restore();
	}

	// Everything that the graphics processor has: again after it was lost.
	restore() {
		const gl = this.gl;

		this.made++;
		this.surfaceProgram = new Program(gl, VERTEX, SURFACE);
		this.wireProgram = new Program(gl, VERTEX, WIRE);
		gl.enable(gl.DEPTH_TEST);
		gl.clearColor(0, 0, 0, 0);
		gl.polygonOffset(1, 1);
		gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
	}

	// A part that the graphics processor has; `lists` of numbers of vertices are made when they are drawn.
	use(part) {
		const gl = this.gl, {vertices} = part.mesh;

		if (part.made === this.made) {
			gl.bindVertexArray(part.array);
			return;
		}
		Object.assign(part, {made: this.made, lists: new Map(), array: gl.createVertexArray(), numbers: gl.createBuffer()});
		gl.bindVertexArray(part.array);
		gl.bindBuffer(gl.ARRAY_BUFFER, part.numbers);
		gl.bufferData(gl.ARRAY_BUFFER, this.halve > 1 ? vertices.map(n => n >> 1) : vertices, gl.STATIC_DRAW);
		gl.enableVertexAttribArray(0);
		gl.vertexAttribIPointer(0, 3, gl.INT, 0, 0);
	}

	// Of a part that is in use: the list of this name.
	list(part, name, make) {
		const had = part.lists.get(name);

		if (had)
			this.gl.bindBuffer(this.gl.ELEMENT_ARRAY_BUFFER, had.buffer);
		else
			part.lists.set(name, this.indices(make()));
		return part.lists.get(name);
	}

	edges(part) {
		return this.list(part, "edges", () => edgesOf(part.mesh));
	}

	drop(part) {
		if (part.made !== this.made)
			return;
		for (const {buffer} of part.lists.values())
			this.gl.deleteBuffer(buffer);
		this.gl.deleteBuffer(part.numbers);
		this.gl.deleteVertexArray(part.array);
		part.made = 0;
	}

	indices(list) {
		const gl = this.gl, buffer = gl.createBuffer();

		gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
		gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, list, gl.STATIC_DRAW);
		return {buffer, count: list.length};
	}

	// `items`: what is drawn, {part}; perhaps with domains, the name and numbers of a list in place of all triangles, `back` (how
	// far it yields, a length), `coarse` (its triangles are not those of the mesh). `drop`: how far skirts hang down. `heights`: the
	// axis of z. Everything else that changes from picture to picture is in the state.
	draw(camera, heights, items, drop = 0) {
		const gl = this.gl, canvas = this.canvas, state = this.state;

		gl.viewport(0, 0, canvas.width, canvas.height);
		gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
		const place = camera.target.map((n, axis) => this.halve * Math.round((n + this.surface.middle[axis]) / this.halve)); // whole
		const relative = place.map((n, axis) => n - this.surface.middle[axis]);
		const common = {
			origin: place.map(n => n / this.halve), step: this.step.map(s => s * this.halve), exaggeration: camera.exaggeration,
			camera: camera.matrix(relative), drop, away: camera.axes()[2].map(n => -n),
		};
		if (state.wire)
			gl.enable(gl.POLYGON_OFFSET_FILL);
		this.drawSurface({...common, ...this.colours(relative[2], heights)}, items);
		gl.disable(gl.POLYGON_OFFSET_FILL);
		if (state.wire)
			this.drawWire(common, camera, items);
	}

	// Of the shader: what depends on the height of the origin. Contours are at multiples of the interval, counted from zero.
	colours(origin, heights) {
		const {mode, interval, range} = this.state, length = this.step[2] / heights.step, height = heights.base + heights.local(origin);
		const above = n => (height % n + n) % n / n;

		return {
			mode, thick: 1.1 * (window.devicePixelRatio || 1), ramp: new Float32Array((mode === 2 ? SLOPES : HEIGHTS).flat()),
			range: range.map(n => (n - height) * length),
			contour: interval ? [1 / (interval * length), 1 / (5 * interval * length)] : [0, 0],
			phase: interval ? [above(interval), above(5 * interval)] : [0, 0],
		};
	}

	drawSurface(uniforms, items) {
		const gl = this.gl, program = this.surfaceProgram;

		program.use(uniforms);
		for (const {part, domains, name, numbers, back = 0} of items) {
			this.use(part);
			const list = this.list(part, name || "faces", () => numbers || part.mesh.faces);
			program.set({skirt: part.skirt, behind: uniforms.away.map(n => n * back)});
			if (this.state.mode !== 3 || !domains) {
				gl.drawElements(gl.TRIANGLES, list.count, gl.UNSIGNED_INT, 0);
				continue;
			}
			domains.forEach((domain, i) => {
				program.set({domain: domainColour(i)});
				for (const [from, count] of domain.ranges)
					gl.drawElements(gl.TRIANGLES, 3 * count, gl.UNSIGNED_INT, 12 * from);
			});
		}
	}

	drawWire(common, camera, items) {
		const gl = this.gl;
		// Where triangles are smaller than some pixels their edges would be all that one sees.
		const edge = camera.radius() * 1.4 / Math.sqrt(this.surface.count) / camera.pixel();
		const ink = this.state.mode === 0 ? [0.05, 0.22, 0.42] : [0.04, 0.06, 0.09];

		this.wireProgram.use({...common, skirt: 2 ** 31 - 1, behind: [0, 0, 0], ink: [...ink, Math.min(0.62, Math.max(0.12, edge / 14))]});
		gl.enable(gl.BLEND);
		for (const {part, coarse} of items) {
			if (coarse)
				continue;
			this.use(part);
			gl.drawElements(gl.LINES, this.edges(part).count, gl.UNSIGNED_INT, 0);
		}
		gl.disable(gl.BLEND);
	}
}

// Each edge once. Inside of the mesh an edge goes up in one of its triangles (to a higher number) and down in the other; of those
// that go down, only the ones that never go up are added. The work is in proportion to the edges, however many a vertex has.
function edgesOf(mesh) {
	const count = mesh.vertices.length / 3, up = neighbours(mesh.faces, count, true), down = neighbours(mesh.faces, count, false);
	const edges = new Uint32Array(2 * (up.to.length + down.to.length)), seen = new Uint32Array(count);
	let at = 0;

	for (let a = 0; a < count; a++) {
		for (const {first, to} of [up, down]) {
			for (let i = first[a]; i < first[a + 1]; i++) {
				if (seen[to[i]] === a + 1)
					continue;
				seen[to[i]] = a + 1;
				edges[at++] = a;
				edges[at++] = to[i];
			}
		}
	}
	return edges.slice(0, at);
}

// The higher ends of edges that go up, or down, by their lower ends: those of vertex a are to[first[a]] to to[first[a + 1] - 1].
function neighbours(faces, count, up) {
	const first = new Uint32Array(count + 1);
	const each = visit => {
		for (let i = 0; i < faces.length; i++) {
			const a = faces[i], b = faces[i % 3 === 2 ? i - 2 : i + 1];
			if (a < b === up)
				visit(up ? a : b, up ? b : a);
		}
	};

	each(a => first[a + 1]++);
	for (let i = 1; i < first.length; i++)
		first[i] += first[i - 1];
	const to = new Uint32Array(first[count]), next = first.slice();
	each((a, b) => {
		to[next[a]++] = b;
	});
	return {first, to};
}

// A program with its uniforms by name.
class Program {
	constructor(gl, vertex, fragment) {
		const program = this.program = gl.createProgram();

		this.gl = gl;
		for (const [type, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
			const shader = gl.createShader(type);
			gl.shaderSource(shader, source);
			gl.compileShader(shader);
			gl.attachShader(program, shader);
			if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost())
				throw new Error("the shader cannot be compiled: " + gl.getShaderInfoLog(shader));
		}
		gl.bindAttribLocation(program, 0, "number");
		gl.linkProgram(program);
		if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost())
			throw new Error("the shaders cannot be linked: " + gl.getProgramInfoLog(program));
		this.uniform = {};
		const n = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) || 0;
		for (let i = 0; i < n; i++) {
			const {name, type} = gl.getActiveUniform(program, i), plain = name.replace("[0]", "");
			this.uniform[plain] = {at: gl.getUniformLocation(program, name), type};
		}
	}

	use(values) {
		this.gl.useProgram(this.program);
		this.set(values);
	}

	set(values) {
		const gl = this.gl;
		const setters = {
			[gl.INT]: "uniform1i", [gl.FLOAT]: "uniform1f", [gl.INT_VEC3]: "uniform3iv", [gl.FLOAT_VEC2]: "uniform2fv",
			[gl.FLOAT_VEC3]: "uniform3fv", [gl.FLOAT_VEC4]: "uniform4fv",
		};

		for (const [name, value] of Object.entries(values)) {
			const uniform = this.uniform[name];
			if (uniform && uniform.type === gl.FLOAT_MAT4)
				gl.uniformMatrix4fv(uniform.at, false, value);
			else if (uniform)
				gl[setters[uniform.type]](uniform.at, value);
		}
	}
}

class Missing extends Error {
	constructor(what) {
		super(what);
		this.what = what;
	}
}
