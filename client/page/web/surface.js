// The mesh as a surface: exact heights, and what a ray meets.
//
// All is in lattice numbers relative to the middle of the mesh, so differences of vertices are whole and without an error. A
// grid over the plane lists the triangles that meet each cell. Its lines are close where there are many vertices.

const ENTRIES = 8; // of the grid's list, of each triangle at most
const SAMPLE = 1 << 16;
const GOLDEN = (Math.sqrt(5) - 1) / 2;

// The box of the vertices that triangles use, of lattice numbers.
function boxOf(vertices, faces) {
	const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];

	for (let i = 0; i < faces.length; i++) {
		for (let axis = 0, at = 3 * faces[i]; axis < 3; axis++, at++) {
			const value = vertices[at];

			if (value < low[axis])
				low[axis] = value;
			if (value > high[axis])
				high[axis] = value;
		}
	}
	return {low, high};
}

// The lines between columns, or rows, whose numbers are from 0 on: whole numbers, as many places between each two.
class Lines {
	// From the sorted places of a sample; `most`: columns.
	constructor(low, high, places, most) {
		const at = [low];

		for (let i = 1; i < most; i++) {
			const place = places[Math.floor(i / most * places.length)];
			if (place > at[at.length - 1])
				at.push(place);
		}
		this.count = at.length;
		this.at = Float64Array.of(...at, high + 1);
		// Equal parts of the whole say between which lines to search.
		this.low = low;
		this.parts = 4 * this.count;
		this.perPart = this.parts / (high + 1 - low);
		this.first = new Uint16Array(this.parts + 1).fill(this.count - 1);
		for (let line = this.count - 1; line > 0; line--)
			this.first.fill(line - 1, 0, this.part(at[line]) + 1);
	}

	part(n) {
		return Math.min(this.parts - 1, Math.max(0, Math.floor((n - this.low) * this.perPart)));
	}

	// The column that a number is in: the last line that it is not below.
	find(n) {
		const {at, first} = this, part = this.part(n);
		let low = first[part], high = first[part + 1];

		while (low < high) {
			const middle = (low + high + 1) >> 1;
			if (at[middle] <= n)
				low = middle;
			else
				high = middle - 1;
		}
		return low;
	}

	ofVertices(vertices, axis, middle) {
		const of = new Uint16Array(vertices.length / 3);

		for (let i = 0, at = axis; i < of.length; i++, at += 3)
			of[i] = this.find(vertices[at] - middle);
		return of;
	}
}

class Surface {
	// `middle`: that of the whole mesh, if this is a part of one.
	constructor(mesh, middle) {
		this.faces = mesh.faces;
		this.vertices = mesh.vertices;
		this.count = mesh.faces.length / 3;
		this.box = boxOf(mesh.vertices, mesh.faces);
		this.middle = middle || this.box.low.map((low, axis) => low + Math.floor((this.box.high[axis] - low) / 2));
		this.low = this.box.low.map((n, axis) => n - this.middle[axis]);
		this.high = this.box.high.map((n, axis) => n - this.middle[axis]);
		this.corner = new Float64Array(9); // of the triangle that was loaded
		this.makeGrid();
	}

	// ---- the grid ----

	// Cells are so large that triangles are in few of them. Long ones are in many, as in a fan: then cells are made larger.
	makeGrid() {
		const places = [0, 1].map(axis => this.sample(axis)), most = ENTRIES * this.count + 1000;

		for (let cells = Math.max(1, this.count / 3); !this.fill(places, cells, most);)
			cells /= 4;
	}

	// Of one coordinate, from corners of all parts of the mesh, sorted.
	sample(axis) {
		const n = Math.min(SAMPLE, this.faces.length), places = new Float64Array(n);

		for (let i = 0; i < n; i++)
			places[i] = this.vertices[3 * this.faces[Math.floor(i * GOLDEN % 1 * this.faces.length)] + axis] - this.middle[axis];
		return places.sort();
	}

	// False if there are more entries than `most`.
	fill(places, cells, most) {
		// Nine tenths of the corners say how the mesh is shaped, whatever is far from all.
		const [wide, tall] = places.map(p => Math.max(1, p[Math.floor(0.95 * (p.length - 1))] - p[Math.ceil(0.05 * (p.length - 1))]));
		const columns = Math.min(Math.max(1, Math.round(Math.sqrt(cells * wide / tall))), Math.max(1, Math.round(cells)), 4096);
		const rows = Math.min(Math.max(1, Math.round(cells / columns)), 4096);

		this.lines = [columns, rows].map((n, axis) => new Lines(this.low[axis], this.high[axis], places[axis], n));
		[this.columns, this.rows] = this.lines.map(lines => lines.count);
		const boxes = this.cellBoxes(), start = new Uint32Array(this.columns * this.rows + 1);
		let left = cells > 1 ? most : Infinity;
		this.eachCell(boxes, cell => {
			start[cell + 1]++;
			return --left >= 0;
		});
		if (left < 0)
			return false;
		for (let i = 1; i < start.length; i++)
			start[i] += start[i - 1];
		const list = new Uint32Array(start[start.length - 1]), next = start.slice();
		this.eachCell(boxes, (cell, triangle) => {
			list[next[cell]++] = triangle;
			return true;
		});
		this.start = start;
		this.list = list;
		return true;
	}

	column(x) {
		return this.lines[0].find(x);
	}

	row(y) {
		return this.lines[1].find(y);
	}

	// First and last column, first and last row of each triangle. They are searched once for a vertex: much of the time until a page
	// is ready is spent here.
	cellBoxes() {
		const {faces, vertices, count} = this, boxes = new Uint16Array(4 * count);

		for (let axis = 0; axis < 2; axis++) {
			const of = this.lines[axis].ofVertices(vertices, axis, this.middle[axis]);

			for (let t = 0, at = 2 * axis; t < count; t++, at += 4) {
				const a = of[faces[3 * t]], b = of[faces[3 * t + 1]], c = of[faces[3 * t + 2]];

				boxes[at] = a < b ? (a < c ? a : c) : b < c ? b : c;
				boxes[at + 1] = a > b ? (a > c ? a : c) : b > c ? b : c;
			}
		}
		return boxes;
	}

	// Calls visit(cell, triangle) for all cells that triangles meet, and perhaps for some beside them, as long as it is true.
	eachCell(boxes, visit) {
		const {columns, count} = this;

		for (let t = 0, at = 0; t < count; t++, at += 4) {
			const c0 = boxes[at], c1 = boxes[at + 1], r0 = boxes[at + 2], r1 = boxes[at + 3];

			if ((r1 - r0) * (c1 - c0) > 4) {
				if (!this.eachOfMany(this.load(t), r0, r1, cell => visit(cell, t)))
					return;
				continue;
			}
			for (let row = r0; row <= r1; row++)
				for (let cell = row * columns + c0; cell <= row * columns + c1; cell++)
					if (!visit(cell, t))
						return;
		}
	}

	// Long thin triangles lie in few of the cells of their box.
	eachOfMany(c, r0, r1, visit) {
		for (let row = r0; row <= r1; row++) {
			const [from, to] = this.span(c, row);

			for (let column = from; column <= to; column++)
				if (!visit(row * this.columns + column))
					return false;
		}
		return true;
	}

	// The columns of a row that a triangle meets.
	span(c, row) {
		const at = this.lines[1].at, y0 = at[row] - 1, y1 = at[row + 1] + 1;
		let low = Infinity, high = -Infinity;

		for (let i = 0, j = 6; i < 9; j = i, i += 3) {
			let [ax, ay, bx, by] = [c[i], c[i + 1], c[j], c[j + 1]];
			if (Math.max(ay, by) < y0 || Math.min(ay, by) > y1)
				continue;
			for (const y of [Math.max(y0, Math.min(ay, by)), Math.min(y1, Math.max(ay, by))]) {
				const x = ay === by ? ax : ax + (bx - ax) * (y - ay) / (by - ay);
				low = Math.min(low, x, ay === by ? bx : x);
				high = Math.max(high, x, ay === by ? bx : x);
			}
		}
		return low <= high ? [this.column(low - 1), this.column(high + 1)] : [0, -1];
	}

	// The corners of a triangle, relative to the middle.
	load(triangle) {
		const corner = this.corner, middle = this.middle;

		for (let i = 0, at = 3 * triangle; i < 3; i++, at++) {
			const v = 3 * this.faces[at];

			corner[3 * i] = this.vertices[v] - middle[0];
			corner[3 * i + 1] = this.vertices[v + 1] - middle[1];
			corner[3 * i + 2] = this.vertices[v + 2] - middle[2];
		}
		return corner;
	}

	// ---- heights ----

	// True if (x, y) is in the triangle that was loaded, or on its border. Both triangles of an edge calculate its sign from the
	// same end, so that no place lies between them.
	holds(x, y) {
		const c = this.corner;

		return side(c, 0, 3, x, y) >= 0 && side(c, 3, 6, x, y) >= 0 && side(c, 6, 0, x, y) >= 0;
	}

	// Height of the plane of the triangle that was loaded: from its first corner, by slopes whose numerators are whole numbers.
	plane() {
		const c = this.corner, bx = c[3] - c[0], by = c[4] - c[1], bz = c[5] - c[2], cx = c[6] - c[0], cy = c[7] - c[1], cz = c[8] - c[2];
		const area = bx * cy - by * cx;

		return {x: c[0], y: c[1], z: c[2], east: (bz * cy - cz * by) / area, north: (cz * bx - bz * cx) / area};
	}

	// The height at (x, y), relative as all others; NaN outside of the mesh.
	height(x, y) {
		if (!(x >= this.low[0] && x <= this.high[0] && y >= this.low[1] && y <= this.high[1]))
			return NaN;
		const cell = this.row(y) * this.columns + this.column(x);

		for (let i = this.start[cell]; i < this.start[cell + 1]; i++) {
			this.load(this.list[i]);
			if (this.holds(x, y))
				return heightAt(this.plane(), x, y);
		}
		return NaN;
	}

	// The same with how far off it may be.
	find(x, y) {
		return {z: this.height(x, y), error: 0};
	}

	// [{t, z}, ...] as sectionOf has them.
	section(x0, y0, x1, y1) {
		return {line: sectionOf(this, x0, y0, x1, y1), error: 0};
	}

	// ---- rays ----

	// The first place where from + t * along, t >= 0, meets the surface: [x, y, z], or null.
	hit(from, along) {
		const [enter, leave] = this.clip(from, along);
		let best = Infinity;

		for (const step of this.walk(from, along, enter, leave)) {
			for (let i = this.start[step.cell]; i < this.start[step.cell + 1]; i++) {
				this.load(this.list[i]);
				const t = this.meet(from, along);
				if (t >= enter && t < best)
					best = t;
			}
			if (best <= step.leave)
				break;
		}
		if (best === Infinity)
			return null;
		return [0, 1, 2].map(axis => from[axis] + best * along[axis]);
	}

	// Where a ray meets the triangle that was loaded: t, or Infinity.
	meet(from, along) {
		const p = this.plane();
		const fall = along[2] - p.east * along[0] - p.north * along[1];
		const t = (heightAt(p, from[0], from[1]) - from[2]) / fall;

		return Number.isFinite(t) && this.holds(from[0] + t * along[0], from[1] + t * along[1]) ? t : Infinity;
	}

	// The part of a ray that is in the box of the mesh, one step larger on all sides.
	clip(from, along) {
		let enter = 0, leave = Infinity;

		for (let axis = 0; axis < 3; axis++) {
			const a = (this.low[axis] - 1 - from[axis]) / along[axis], b = (this.high[axis] + 1 - from[axis]) / along[axis];

			if (along[axis] === 0) {
				if (from[axis] < this.low[axis] - 1 || from[axis] > this.high[axis] + 1)
					leave = -1;
			} else {
				enter = Math.max(enter, Math.min(a, b));
				leave = Math.min(leave, Math.max(a, b));
			}
		}
		return [enter, leave];
	}

	// The cells under a ray between two t, in order, each with the t at which the ray leaves it.
	*walk(from, along, enter, leave) {
		if (!(enter <= leave))
			return;
		let column = this.column(from[0] + enter * along[0]), row = this.row(from[1] + enter * along[1]);
		const border = (axis, n) => along[axis] === 0 ? Infinity :
			(this.lines[axis].at[along[axis] > 0 ? n + 1 : n] - from[axis]) / along[axis];

		for (;;) {
			const x = border(0, column), y = border(1, row);
			yield {cell: row * this.columns + column, leave: Math.min(x, y, leave)};
			if (Math.min(x, y) > leave)
				return;
			if (x <= y)
				column += along[0] > 0 ? 1 : -1;
			else
				row += along[1] > 0 ? 1 : -1;
			if (column < 0 || row < 0 || column >= this.columns || row >= this.rows)
				return;
		}
	}
}

// On which side of the edge between two corners a place is: above 0 on the left.
function side(c, i, j, x, y) {
	const ax = c[i], ay = c[i + 1], bx = c[j], by = c[j + 1];

	if (ax < bx || (ax === bx && ay < by))
		return (bx - ax) * (y - ay) - (by - ay) * (x - ax);
	return (bx - ax) * (y - by) - (by - ay) * (x - bx);
}

const heightAt = (p, x, y) => p.z + p.east * (x - p.x) + p.north * (y - p.y);
