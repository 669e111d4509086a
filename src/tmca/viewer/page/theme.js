// Colours of what is drawn beside the pictures: on a dark ground, or on a light one as paper is.
const GROUNDS = {
  dark: { ground: [0.078, 0.082, 0.09], text: "#dfe2e6", quiet: "#9aa1ab", line: "#33373d", tick: "#5b626b", bars: "#717a86", truth: "#f2f4f7", darker: 0 },
  light: { ground: [1, 1, 1], text: "#1b1e22", quiet: "#565d66", line: "#dcdfe3", tick: "#8b929b", bars: "#9aa1ab", truth: "#14171a", darker: 36 },
};
export const ink = { name: "dark", ...GROUNDS.dark };

export function useGround(name, page) {
  Object.assign(ink, { name, ...GROUNDS[name] });
  page.dataset.ground = name;
}

// A bright colour as it can be read on the ground.
export const onGround = (colour) => (ink.darker ? `color-mix(in srgb, ${colour}, #000 ${ink.darker}%)` : colour);
