/** Things that have names, in a list that a person looks through. */

/** Those with `part` in their names, as people order names: 2 before 10. */
export function named<Thing extends { name: string }>(things: readonly Thing[], part: string): Thing[] {
  const wanted = part.trim().toLowerCase();
  const found = things.filter((thing) => thing.name.toLowerCase().includes(wanted));
  return found.sort((a, b) => a.name.localeCompare(b.name, "en", { numeric: true }));
}
