/** Whether the LiDAR is shown beside the frame that is marked: as the person chose, else where there is room. */

const KEY = "apexcal.beside";
/** The frame keeps at least 830 pixels. */
const ROOMY_PX = 1600;

export function isBeside(): boolean {
  const chosen = localStorage.getItem(KEY);
  return chosen === null ? innerWidth >= ROOMY_PX : chosen === "yes";
}

export function keepBeside(chosen: boolean): void {
  try {
    localStorage.setItem(KEY, chosen ? "yes" : "no");
  } catch {
    // It holds for this page.
  }
}
