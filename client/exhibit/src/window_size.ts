/** Counts resize events: reading the size itself forces a layout each time. */
export const windowSize = { changes: 0 };
addEventListener("resize", () => (windowSize.changes += 1));
