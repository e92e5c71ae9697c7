// What the page has of the mesh: lines of base64, each deflated, of differences between whole numbers.

function bytesOf(base64) {
	const text = atob(base64), bytes = new Uint8Array(text.length);

	for (let i = 0; i < bytes.length; i++)
		bytes[i] = text.charCodeAt(i);
	return bytes;
}

async function inflate(line) {
	const stream = new Blob([bytesOf(line)]).stream().pipeThrough(new DecompressionStream("deflate-raw"));

	return new Uint8Array(await new Response(stream).arrayBuffer());
}

// All lines of a text, as bytes.
const inflateLines = text => Promise.all(text.split("\n").map(l => l.trim()).filter(l => l).map(inflate));

// Of an element; the text is given back to the browser.
function linesOf(id) {
	const element = document.getElementById(id), lines = inflateLines(element.textContent);

	element.textContent = "";
	return lines;
}

// Numbers of seven bits a byte, the low ones first.
class Numbers {
	constructor(bytes) {
		this.bytes = bytes;
		this.at = 0;
	}

	next() {
		const bytes = this.bytes;
		let byte = bytes[this.at++], n = byte & 127, factor = 128;

		for (; byte > 127; factor *= 128) {
			byte = bytes[this.at++];
			n += (byte & 127) * factor;
		}
		if (byte === undefined)
			throw new Error("a line of the page is cut off");
		return n;
	}

	// 0, -1, 1, -2, ... as 0, 1, 2, 3, ...
	difference() {
		const n = this.next();

		return n % 2 ? -(n + 1) / 2 : n / 2;
	}
}

// x, y, z of vertex i at 3 * i: lattice numbers.
function readVertices(lines, count) {
	const vertices = new Int32Array(3 * count);
	let from = 0;

	for (const line of lines) {
		const numbers = new Numbers(line), n = numbers.next();

		if (from + n > count)
			throw new Error("the page has more vertices than it says");
		for (let axis = 0; axis < 3; axis++) {
			for (let i = 0, value = 0, at = 3 * from + axis; i < n; i++, at += 3) {
				value += numbers.difference();
				vertices[at] = value;
			}
		}
		from += n;
	}
	if (from !== count)
		throw new Error("the page has fewer vertices than it says");
	return vertices;
}

// Vertices of triangle t at 3 * t, counter-clockwise, and the domains as {key, ranges: [[first triangle, how many], ...]}.
function readFaces(lines, count, vertices) {
	const faces = new Uint32Array(3 * count), domains = new Map();
	let from = 0;

	for (const line of lines) {
		const numbers = new Numbers(line), n = numbers.next(), key = numbers.next();

		if (from + n > count)
			throw new Error("the page has more triangles than it says");
		for (let i = 0, value = 0, at = 3 * from; i < n; i++, at += 3) {
			value += numbers.next();
			faces[at] = value;
			if (value >= vertices)
				throw new Error("a triangle of the page has no such vertex");
		}
		for (let corner = 1; corner < 3; corner++)
			for (let i = 0, at = 3 * from; i < n; i++, at += 3)
				faces[at + corner] = faces[at] - numbers.next();
		if (!domains.has(key))
			domains.set(key, {key, ranges: []});
		domains.get(key).ranges.push([from, n]);
		from += n;
	}
	if (from !== count)
		throw new Error("the page has fewer triangles than it says");
	return {faces, domains: [...domains.values()]};
}

async function meshOf(counts, vertexText, faceText) {
	const [vertexLines, faceLines] = await Promise.all([vertexText, faceText]);
	const vertices = readVertices(vertexLines, counts.vertices);

	return {vertices, ...readFaces(faceLines, counts.triangles, counts.vertices)};
}

// The mesh of a page, or of a folder: then its vertices and triangles are in tiles.
async function readMesh() {
	const facts = JSON.parse(document.getElementById("facts").textContent);

	if (facts.levels)
		return {facts, domains: [], levels: facts.triangles ? await Levels.open(facts) : null};
	return {facts, ...await meshOf(facts, linesOf("vertices"), linesOf("faces"))};
}
