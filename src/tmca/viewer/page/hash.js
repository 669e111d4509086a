// The part of the address after # keeps the view.

export function readHash() {
  return Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
}

export function writeHash(view) {
  const given = Object.entries(view).filter(([, value]) => value !== null && value !== undefined && value !== "");
  const text = new URLSearchParams(given).toString().replaceAll("%2C", ",").replaceAll("%3B", ";");
  history.replaceState(null, "", `#${text}`);
}

export const numbersOf = (text) => (text ?? "").split(",").filter((part) => part !== "").map(Number);

export const groupsOf = (text, length) =>
  (text ?? "").split(";").map(numbersOf).filter((group) => group.length === length && group.every(Number.isFinite));
