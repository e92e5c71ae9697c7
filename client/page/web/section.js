// The exact section of the surface along a line: where it crosses each edge, and nothing between.

// From (x0, y0) to (x1, y1), relative lattice numbers: [{t, z}, ...] with t from 0 to 1, in order; z is NaN where a gap begins.
const sectionOf = (surface, x0, y0, x1, y1) => joinPieces(piecesOf(surface, x0, y0, x1, y1));

// The parts of the line in triangles, in any order.
function piecesOf(surface, x0, y0, x1, y1) {
	const from = [x0, y0, 0], along = [x1 - x0, y1 - y0, 0], seen = new Set(), pieces = [];

	for (const step of surface.walk(from, along, ...clipPlan(surface, from, along))) {
		for (let i = surface.start[step.cell]; i < surface.start[step.cell + 1]; i++) {
			const triangle = surface.list[i];
			if (seen.has(triangle))
				continue;
			seen.add(triangle);
			const piece = pieceOf(surface, triangle, x0, y0, x1, y1);
			if (piece)
				pieces.push(piece);
		}
	}
	return pieces;
}

// The part of 0 <= t <= 1 that is over the box of the mesh.
function clipPlan(surface, from, along) {
	let enter = 0, leave = 1;

	for (let axis = 0; axis < 2; axis++) {
		const a = (surface.low[axis] - from[axis]) / along[axis], b = (surface.high[axis] - from[axis]) / along[axis];

		if (along[axis] === 0) {
			if (from[axis] < surface.low[axis] || from[axis] > surface.high[axis])
				leave = -1;
		} else {
			enter = Math.max(enter, Math.min(a, b));
			leave = Math.min(leave, Math.max(a, b));
		}
	}
	return [enter, leave];
}

// The part of the line in a triangle: {t0, z0, t1, z1}; null if it has no length.
function pieceOf(surface, triangle, x0, y0, x1, y1) {
	const c = surface.load(triangle);
	let enter = 0, leave = 1;

	for (let i = 0, j = 3; i < 9; i += 3, j = (j + 3) % 9) {
		const a = side(c, i, j, x0, y0), b = side(c, i, j, x1, y1);

		if (a < 0 && b < 0)
			return null;
		if (a < 0)
			enter = Math.max(enter, a / (a - b));
		else if (b < 0)
			leave = Math.min(leave, a / (a - b));
	}
	if (!(leave - enter > 1e-13))
		return null;
	const p = surface.plane(), z = t => heightAt(p, x0 + t * (x1 - x0), y0 + t * (y1 - y0));
	return {t0: enter, z0: z(enter), t1: leave, z1: z(leave)};
}

function joinPieces(pieces) {
	const line = [];

	pieces.sort((a, b) => a.t0 - b.t0 || a.t1 - b.t1);
	for (const piece of pieces) {
		const last = line[line.length - 1];

		if (last && piece.t0 - last.t > 1e-9)
			line.push({t: last.t, z: NaN});
		if (!last || piece.t0 - last.t > 1e-9)
			line.push({t: piece.t0, z: piece.z0});
		if (!last || piece.t1 > line[line.length - 1].t)
			line.push({t: piece.t1, z: piece.z1});
	}
	return line;
}
