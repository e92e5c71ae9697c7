// A mesh in a folder: a tree of tiles. What is drawn is a cut through it, finer where one is near. Tiles are scripts that call one
// function, since a page that is a file may read no other files; they are read when they are needed, and forgotten when there are
// too many.

const DRAWN = 1.5e6;   // triangles in one picture, at most
const KEPT = 3e6;      // that are loaded, but for those of the picture
const AT_ONCE = 6;     // tiles that are read at the same time
const STEP_PIXELS = 2.5; // of a grid where its error is seen, at most
const MUCH_LOST = 0.1; // of the corners below a grid
const NARROW_PIXELS = 0.25;
const LONG_PROFILE = 3000; // leaves that a profile reads, at most

class Levels {
	static async open(facts) {
		const levels = new Levels(facts);

		await levels.load(levels.root);
		return levels;
	}

	constructor(facts) {
		const {root} = this.facts = facts.levels;

		this.box = {low: root.box.slice(0, 3), high: root.box.slice(3)};
		this.middle = this.box.low.map((low, axis) => low + Math.floor((this.box.high[axis] - low) / 2));
		this.low = this.box.low.map((n, axis) => n - this.middle[axis]);
		this.high = this.box.high.map((n, axis) => n - this.middle[axis]);
		this.count = facts.triangles;
		this.root = new Tile(this, null, 0, 0, 0, root);
		this.most = DRAWN;
		this.kept = KEPT;
		this.drawn = [];   // tiles of the last picture
		this.picture = 0;  // their number
		this.loaded = new Set();
		this.wanted = [];  // tiles of the last picture that are still to be read
		this.reading = new Map();
		this.sections = new Map();
		this.changed = () => {};
		window.acutTile = (stamp, name, about, ...texts) => {
			const called = this.reading.get(name);
			if (called)
				called.came = {stamp, about, texts};
		};
	}

	// Heights for the ramp.
	sample() {
		const {mesh} = this.root;

		if (mesh.faces.length)
			return {vertices: mesh.vertices, faces: mesh.faces};
		return {vertices: [...this.box.low, ...this.box.high], faces: [0, 1]};
	}

	// ---- reading ----

	load(tile) {
		const had = this.reading.get(tile.name);

		if (tile.loaded)
			return Promise.resolve();
		if (had)
			return had.tile === tile ? had.done : had.done.then(() => this.load(tile)); // one that was forgotten meanwhile
		const read = {tile, parent: tile.parent};
		this.reading.set(tile.name, read);
		tile.state = "reading";
		read.done = this.read(tile, read).then(() => this.loaded.add(tile), error => {
			tile.state = "failed";
			throw error;
		}).finally(() => this.reading.delete(tile.name));
		return read.done;
	}

	async read(tile, read) {
		const file = `tile_${tile.name}.js`, script = document.createElement("script");

		await new Promise((done, failed) => {
			script.onload = done;
			script.onerror = () => failed(new Error(`${file} is not beside the page, or cannot be read`));
			script.src = file;
			document.head.append(script);
		}).finally(() => script.remove());
		if (!read.came || read.came.stamp !== this.facts.stamp)
			throw new Error(`${file} is of another mesh`);
		await tile.take(read.came.about, read.came.texts);
	}

	// Reads what the last picture lacks, the worst first.
	readMore() {
		while (this.reading.size < AT_ONCE && this.wanted.length) {
			const tile = this.wanted.shift();
			if (tile.state === "none")
				this.load(tile).then(() => this.came(), error => this.fail(error));
		}
	}

	// A picture for several tiles that come together.
	came() {
		this.readMore();
		if (!this.soon)
			this.soon = setTimeout(() => {
				this.soon = 0;
				this.stale = true;
				this.changed();
			}, 100);
	}

	fail(error) {
		console.error(error);
		this.error = error;
		$("message").hidden = false;
		$("message-text").textContent = "A tile of the mesh is missing.";
		$("message-more").textContent = String(error.message || error);
		this.changed();
	}

	// Resolved when nothing is to be read for the picture any more.
	async settled() {
		do {
			await Promise.allSettled([...this.reading.values()].map(read => read.done));
			await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
		} while (this.reading.size || this.wanted.length || this.soon || this.stale);
	}

	// Tiles that no picture has used for the longest time go, from the leaves on: those with children that are loaded stay.
	forget(scene) {
		let sum = 0;

		for (const tile of this.loaded)
			sum += tile.triangles;
		for (let old = [null]; sum > this.kept && old.length;) {
			const parents = new Set([...this.loaded, ...this.reading.values()].map(tile => tile.parent));
			old = [...this.loaded].filter(t => t.used < this.picture && t.parent && !parents.has(t)).sort((a, b) => a.used - b.used);
			for (const tile of old) {
				if (sum <= this.kept)
					return;
				sum -= tile.triangles;
				tile.forget(scene);
				this.loaded.delete(tile);
			}
		}
	}

	// ---- what is drawn ----

	// {items, error, drop, border, waiting}: for the scene, how far the worst of them is off, the longest step of those with a border, and whether better ones are being read.
	cut(camera, scene) {
		const view = new View(camera), list = [], open = [this.root];
		let triangles = this.root.triangles;

		this.picture++;
		this.stale = false;
		this.wanted = [];
		while (open.length) {
			let worst = 0;
			open.forEach((tile, i) => worst = view.need(tile) > view.need(open[worst]) ? i : worst);
			const [tile] = open.splice(worst, 1);
			const children = this.divide(tile, view, triangles);
			this.use(tile);
			if (!children) {
				list.push(tile);
				continue;
			}
			tile.divided = this.picture;
			open.push(...children);
			triangles += children.reduce((sum, t) => sum + t.triangles, -tile.triangles);
		}
		this.drawn = list.filter(t => view.sees(t));
		this.readMore();
		this.forget(scene);
		return {items: this.items(list, camera), error: Math.max(0, ...this.drawn.map(t => t.error)), drop: this.drop(camera), border: Math.max(0, ...this.drawn.map(t => t.lost && t.step)), waiting: this.wanted.length + this.reading.size > 0};
	}

	// How far skirts hang down: as far as heights at a border may differ, but for cliffs, so that they are not seen at the ends of the
	// mesh.
	drop(camera) {
		const steps = camera.steps(), grids = this.drawn.filter(t => t.grid);

		return Math.min(2 * Math.max(0, ...grids.map(t => t.error)) * steps[2], 3 * Math.max(0, ...grids.map(t => t.step)) * steps[0]) / camera.exaggeration;
	}

	use(tile) {
		tile.used = this.picture;
	}

	// The children in place of a tile; null: it is fine enough, or they are not all loaded.
	divide(tile, view, triangles) {
		if (!tile.grid || view.need(tile) <= 1)
			return null;
		const children = tile.children.map(c => c.tile).filter(t => t && view.sees(t)), missing = children.filter(t => !t.loaded);

		if (triangles + children.reduce((sum, t) => sum + t.triangles, -tile.triangles) > this.most)
			return null;
		children.forEach(t => this.use(t)); // those that wait for others, too
		this.wanted.push(...missing.filter(t => t.state === "none"));
		return missing.length ? null : children;
	}

	// Leaves end at their triangles, not at their squares: between leaves and grids the grid of their parent is where triangles of other
	// leaves are.
	items(list, camera) {
		const steps = camera.steps(), items = [], drawn = new Set(list.map(t => t.name));
		const coarse = list.some(t => t.grid), parents = new Set(list.map(t => t.parent).filter(p => p));
		// Enough to have triangles over the grid where both are, and not so much that a cliff behind comes forward.
		const back = tile => Math.min(tile.error * steps[2], tile.step * steps[0]) * 2;

		for (const tile of list) {
			items.push({part: tile.part, coarse: tile.grid, back: tile.grid ? back(tile) : 0});
			for (const [side, numbers] of tile.grid ? tile.skirts.entries() : [])
				if (numbers.length && this.ends(tile, side, drawn))
					items.push({part: tile.part, coarse: true, name: "skirt" + side, numbers, back: back(tile)});
		}
		for (const parent of coarse ? parents : [])
			parent.children.forEach(({tile, border}, i) => {
				if (border.length && !(tile && tile.grid))
					items.push({part: parent.part, coarse: true, name: "border" + i, numbers: border, back: back(parent)});
			});
		return items;
	}

	// Whether what is drawn beside a grid is of another step; equal ones have the same heights at their border.
	ends(tile, side, drawn) {
		const at = [tile.x, tile.y], most = 2 ** tile.depth;

		at[side < 2 ? 1 : 0] += side % 2 ? 1 : -1;
		if (at.some(n => n < 0 || n >= most))
			return false;
		const beside = this.tileAt(tile.depth, ...at);
		return !(beside && beside.grid && drawn.has(beside.name));
	}

	// The tile of a square, or the leaf that has it; null: there is none.
	tileAt(depth, x, y) {
		let tile = this.root;

		while (tile && tile.depth < depth && tile.grid && tile.children) {
			const down = depth - tile.depth - 1;
			tile = tile.children[(Math.floor(x / 2 ** down) & 1) + 2 * (Math.floor(y / 2 ** down) & 1)].tile;
		}
		return tile;
	}

	// ---- heights ----

	// The height at a place, from the finest tile that is loaded, and how far it may be off: 0 where the triangle there is loaded, or it
	// is known that there is none.
	find(x, y) {
		let unknown = false, z = NaN, grid = null;
		const search = tile => {
			if (!tile.holds(x, y))
				return;
			if (!tile.loaded) {
				unknown = true;
				return;
			}
			if (!tile.grid)
				z = Number.isNaN(z) && tile.surface ? tile.surface.height(x, y) : z;
			else
				tile.children.forEach(c => c.tile && search(c.tile));
		};

		search(this.root);
		if (!Number.isNaN(z) || !unknown)
			return {z, error: 0};
		for (let tile = this.root; tile && tile.loaded && tile.grid;) {
			const h = tile.surface ? tile.surface.height(x, y) : NaN;
			grid = Number.isNaN(h) ? grid : {z: h, error: tile.error};
			const [cx, cy] = [x, y].map((n, axis) => n + this.middle[axis] >= tile.corner[axis] + tile.step * this.facts.side / 2 ? 1 : 0);
			tile = tile.children[cx + 2 * cy].tile;
		}
		return grid || {z: NaN, error: this.root.error};
	}

	height(x, y) {
		return this.find(x, y).z;
	}

	// The leaves whose boxes `meets` is true for, one after the other: all of them are read.
	async eachLeaf(meets, visit, tile = this.root) {
		if (!meets(tile))
			return;
		await this.load(tile);
		this.use(tile);
		if (!tile.grid)
			visit(tile);
		else
			for (const {tile: child} of tile.children || [])
				if (child)
					await this.eachLeaf(meets, visit, child);
	}

	// The height of the triangle at a place, whatever must be read for it.
	async exact(x, y) {
		let z = NaN;

		await this.eachLeaf(tile => Number.isNaN(z) && tile.holds(x, y), tile => z = tile.surface.height(x, y));
		return z;
	}

	// The first place where a ray meets what is drawn: [x, y, z], or null.
	hit(from, along) {
		let best = null, least = Infinity;
		const boxes = this.drawn.map(tile => ({tile, enter: enterOf(tile, from, along)})).filter(b => b.enter < Infinity);

		for (const {tile, enter} of boxes.sort((a, b) => a.enter - b.enter)) {
			if (enter > least)
				break;
			const place = tile.surface && tile.surface.hit(from, along), t = place ? partOf(place, from, along) : Infinity;
			if (t < least)
				[best, least] = [place, t];
		}
		return best;
	}

	// ---- profiles ----

	// The section along a line, exact when its leaves were read; until then places of it, as find has them.
	section(x0, y0, x1, y1) {
		const key = [x0, y0, x1, y1].join(), had = this.sections.get(key), n = 500, line = [];
		let error = 0;

		if (had && had.line)
			return had;
		if (!had) {
			this.sections.set(key, {});
			this.exactSection(x0, y0, x1, y1).then(exact => {
				this.sections.set(key, {line: exact, error: 0});
				this.profiled();
			}, reason => reason instanceof TooLong || this.fail(reason));
		}
		for (let i = 0; i <= n; i++) {
			const t = i / n, at = this.find(x0 + t * (x1 - x0), y0 + t * (y1 - y0));
			line.push({t, z: at.z});
			error = Math.max(error, at.error);
		}
		return {line, error};
	}

	async exactSection(x0, y0, x1, y1) {
		const from = [x0, y0, 0], along = [x1 - x0, y1 - y0, 0], pieces = [];
		let leaves = 0;
		const meets = tile => {
			const [enter, leave] = clipPlan(tile, from, along);
			return enter <= leave;
		};

		await this.eachLeaf(meets, tile => {
			if (++leaves > LONG_PROFILE)
				throw new TooLong();
			for (const piece of tile.surface ? piecesOf(tile.surface, x0, y0, x1, y1) : [])
				pieces.push(piece);
			this.came(); // forgets what is not drawn
		});
		return joinPieces(pieces);
	}

	profiled() {
		const {tools} = window.acut.page;

		for (const key of [...this.sections.keys()].slice(0, -200))
			this.sections.delete(key);
		tools.changed();
	}
}

class TooLong extends Error {}

const partOf = (place, from, along) => {
	const axis = [0, 1, 2].reduce((a, b) => Math.abs(along[b]) > Math.abs(along[a]) ? b : a);
	return (place[axis] - from[axis]) / along[axis];
};

// Where a ray enters the box of a tile: t, or Infinity.
function enterOf(tile, from, along) {
	let enter = 0, leave = Infinity;

	for (let axis = 0; axis < 3; axis++) {
		const a = (tile.low[axis] - 1 - from[axis]) / along[axis], b = (tile.high[axis] + 1 - from[axis]) / along[axis];

		if (along[axis] !== 0) {
			enter = Math.max(enter, Math.min(a, b));
			leave = Math.min(leave, Math.max(a, b));
		} else if (from[axis] < tile.low[axis] - 1 || from[axis] > tile.high[axis] + 1) {
			return Infinity;
		}
	}
	return enter <= leave ? enter : Infinity;
}

// What the camera sees of boxes.
class View {
	constructor(camera) {
		const [x, y, z] = camera.axes(), tan = Math.tan(VIEW_ANGLE / 2);

		this.camera = camera;
		this.steps = camera.steps();
		this.axes = [x, y, z];
		this.eye = camera.target.map((n, axis) => n * this.steps[axis] + z[axis] * camera.distance);
		// Length of a pixel, at the distance 1 if it is not parallel.
		this.pixel = camera.parallel ? camera.pixel() : 2 * tan / camera.height;
		this.slope = [tan * camera.width / camera.height, tan];
		this.half = [camera.half() * camera.width / camera.height, camera.half()];
		this.needs = new Map();
	}

	// The box relative to the eye, in units of length.
	ends(tile) {
		return [tile.low, tile.high].map(end => end.map((n, axis) => n * this.steps[axis] - this.eye[axis]));
	}

	// False if all corners are beyond one side of the picture.
	sees(tile) {
		const [low, high] = this.ends(tile), outside = [0, 0, 0, 0, 0];

		for (let i = 0; i < 8; i++) {
			const at = [0, 1, 2].map(axis => (i >> axis & 1 ? high : low)[axis]), [x, y, depth] = [dot(at, this.axes[0]), dot(at, this.axes[1]), -dot(at, this.axes[2])];
			const wide = [0, 1].map(axis => this.camera.parallel ? this.half[axis] : this.slope[axis] * depth);
			[x < -wide[0], x > wide[0], y < -wide[1], y > wide[1], !this.camera.parallel && depth <= 0].forEach((out, side) => outside[side] += out);
		}
		return !outside.includes(8);
	}

	// How much too coarse a grid is: above 1 it should be divided.
	need(tile) {
		if (!tile.grid)
			return 0;
		if (!this.needs.has(tile)) {
			const [low, high] = this.ends(tile), nearest = Math.hypot(...[0, 1, 2].map(axis => Math.max(low[axis], -high[axis], 0)));
			const pixel = this.camera.parallel ? this.pixel : this.pixel * Math.max(nearest, this.camera.distance * 1e-3);
			const step = tile.step * Math.max(this.steps[0], this.steps[1]) / pixel, error = tile.error * this.steps[2] / pixel;
			// Where the error is less than a pixel the shade of slopes is all that is coarse. Narrow meshes need steps that fit into them.
			this.needs.set(tile, step / (tile.lost > MUCH_LOST ? NARROW_PIXELS : error > 1 ? STEP_PIXELS : 4 * STEP_PIXELS));
		}
		return this.needs.get(tile);
	}
}
