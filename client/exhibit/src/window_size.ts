/** Counts the window's changes of size: asking for the size itself makes the browser lay the page out each time. */
export const windowSize = { changes: 0 };
addEventListener("resize", () => (windowSize.changes += 1));
