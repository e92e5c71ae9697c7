// Colours of the surface. Both ramps go from dark to light or back in steps that look equal without a sense of red or green, too.

const rgb = text => [1, 3, 5].map(at => parseInt(text.slice(at, at + 2), 16) / 255);

const HEIGHTS = ["#1f5f80", "#2c8b8f", "#58aa7f", "#9cc06e", "#dccb80", "#f2dfb6", "#fdf6ea"].map(rgb);
const SLOPES = ["#f5f3e8", "#f6dd9a", "#eeaf5b", "#d9713f", "#ab3a45", "#6d1f4d", "#341043"].map(rgb);
const STEEPEST = 60; // degrees: the end of the ramp
const RAMP = HEIGHTS.length; // of both

const css = c => "rgb(" + c.map(v => Math.round(255 * v)).join(" ") + ")";
const gradient = (ramp, way) => "linear-gradient(" + way + "," + ramp.map(css).join(",") + ")";

// One of many colours that differ from their neighbours: hues by the golden section.
function domainColour(i) {
	const hue = i * 0.618034 % 1, light = 0.62 + 0.1 * (i % 3 - 1);

	return [0, 8, 4].map(n => {
		const k = (n + hue * 12) % 12;
		return light - 0.45 * Math.min(light, 1 - light) * Math.max(-1, Math.min(k - 3, 9 - k, 1));
	});
}

// The heights that the ramp is for: of one vertex in a hundred it is below or above, so that a few stray points do not flatten it.
function usualHeights(mesh) {
	const used = Math.min(mesh.faces.length, 60000), heights = new Float64Array(used);

	for (let i = 0; i < used; i++)
		heights[i] = mesh.vertices[3 * mesh.faces[Math.floor(i * mesh.faces.length / used)] + 2];
	heights.sort();
	return [heights[Math.floor(used * 0.01)], heights[Math.ceil(used * 0.99) - 1]];
}
