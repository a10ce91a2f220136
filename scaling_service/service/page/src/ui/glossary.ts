/** What the short names of methods stand for. */

export const METHODS: Record<string, string> = {
  MB: "marker-based: segments scaled by distances between markers",
  MB_lam: "marker-based, then lengths, knee axes and selected marker coordinates fitted to movement",
  MB_am: "marker-based, then knee axes and all marker coordinates fitted to movement",
  EB: "image-based: segments and joint centres from the person's bones",
  EB_am: "image-based, then knee axes and all marker coordinates fitted to movement",
};
