// One tile of a mesh in a folder: a leaf has triangles of the mesh, an inner one a grid of heights whose error is known.

const NO_TRIANGLES = new Uint32Array(0);

class Tile {
	// `about`: triangles below it, whether it is a grid, its error in steps of the lattice, which part of their corners it leaves out, the box of its triangles.
	constructor(levels, parent, depth, x, y, about) {
		const {low, bits, side} = levels.facts, middle = levels.middle, size = 2 ** (bits - depth);

		Object.assign(this, {levels, parent, depth, x, y, grid: about.grid, error: about.error, lost: about.lost, state: "none", used: 0, children: null});
		this.name = `${depth}_${x}_${y}`;
		this.corner = [x, y].map((n, axis) => low[axis] + n * size); // of its square, lattice numbers
		this.step = size / side;
		this.low = [0, 1, 2].map(axis => about.box[axis] - middle[axis]);
		this.high = [0, 1, 2].map(axis => about.box[axis + 3] - middle[axis]);
		this.triangles = about.grid ? 2 * side * side : about.triangles; // when it is loaded, at most
	}

	get loaded() {
		return this.state === "loaded";
	}

	// Whether a place is in the box of its triangles.
	holds(x, y) {
		return x >= this.low[0] && x <= this.high[0] && y >= this.low[1] && y <= this.high[1];
	}

	// Heights, rays and sections in it; made when they are asked for.
	get surface() {
		const {mesh} = this;

		if (!this.made && mesh.faces.length)
			this.made = new Surface({vertices: mesh.vertices, faces: mesh.faces}, this.levels.middle);
		return this.made || null;
	}

	// What its script has.
	async take(facts, texts) {
		const lines = texts.map(inflateLines);

		this.mesh = this.grid ? this.gridOf(new Numbers((await lines[0])[0]), facts.children) : await meshOf(facts, lines[0], lines[1]);
		this.triangles = this.mesh.faces.length / 3;
		this.part = new Part(this.mesh);
		this.state = "loaded";
	}

	forget(scene) {
		scene.drop(this.part);
		this.mesh = this.part = this.made = this.children = this.skirts = null;
		this.state = "none";
	}

	// ---- a grid ----

	gridOf(numbers, children) {
		const {side} = this.levels.facts, row = side + 1, vertices = new Int32Array(3 * (row * row + 4 * row)), has = new Uint8Array(row * row);

		for (let j = 0, begin = 0; j < row; j++) {
			let last = begin, first = true;
			for (let i = 0; i < row; i++) {
				const n = numbers.next(), at = j * row + i, d = n - 1;
				if (!n)
					continue;
				last += d % 2 ? -(d + 1) / 2 : d / 2;
				begin = first ? last : begin;
				first = false;
				has[at] = 1;
				vertices.set([this.corner[0] + i * this.step, this.corner[1] + j * this.step, last], 3 * at);
			}
		}
		this.skirts = skirtsOf(vertices, has, row);
		this.children = children.map((about, i) => ({
			tile: about && new Tile(this.levels, this, this.depth + 1, 2 * this.x + (i & 1), 2 * this.y + (i >> 1), about),
			border: this.borderOf(numbers, has, i),
		}));
		return {vertices, faces: quadsOf(has, row, () => true), skirt: row * row};
	}

	// The triangles of the grid over that part of a child that triangles of other leaves meet.
	borderOf(numbers, has, child) {
		const {side} = this.levels.facts, half = side / 2, quads = new Uint8Array(half * half), x = (child & 1) * half, y = (child >> 1) * half;
		let at = 0;

		for (let runs = numbers.next(), met = 0; runs > 0; runs--, met = 1 - met) {
			const n = numbers.next();
			quads.fill(met, at, at + n);
			at += n;
		}
		const met = (i, j) => i >= x && i < x + half && j >= y && j < y + half && quads[(j - y) * half + i - x];
		return quads.includes(1) ? quadsOf(has, side + 1, met) : NO_TRIANGLES;
	}
}

// The triangles of the quads of a grid, where all of their places have heights. The diagonal goes from the low corner to the high one.
function quadsOf(has, row, where) {
	const list = [];

	for (let j = 0; j < row - 1; j++) {
		for (let i = 0, at = j * row; i < row - 1; i++, at++) {
			if (!has[at] || !has[at + row + 1] || !where(i, j))
				continue;
			if (has[at + 1])
				list.push(at, at + 1, at + row + 1);
			if (has[at + row])
				list.push(at, at + row + 1, at + row);
		}
	}
	return Uint32Array.from(list);
}

// What hangs down from each side of a grid, the lower, upper, left and right one, so that one does not look through where a finer or
// coarser one begins: lists of triangles. The last vertices are theirs.
function skirtsOf(vertices, has, row) {
	const sides = [i => i, i => (row - 1) * row + i, i => i * row, i => i * row + row - 1];

	return sides.map((of, side) => {
		const list = [], hanging = i => row * row + side * row + i;
		for (let i = 0; i < row; i++) {
			vertices.copyWithin(3 * hanging(i), 3 * of(i), 3 * of(i) + 3);
			if (i && has[of(i - 1)] && has[of(i)])
				list.push(of(i - 1), of(i), hanging(i), of(i - 1), hanging(i), hanging(i - 1));
		}
		return Uint32Array.from(list);
	});
}
