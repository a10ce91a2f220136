/** What a browser remembers for the page; nothing where it is told not to, as of a page shown in a sandbox. */

type Memory = Pick<Storage, "getItem" | "setItem" | "removeItem">;

const NOTHING: Memory = { getItem: () => null, setItem: () => undefined, removeItem: () => undefined };

function reached(find: () => Memory): Memory {
  try {
    return find();
  } catch {
    return NOTHING;
  }
}

/** Of this tab. */
export const tab = reached(() => sessionStorage);
/** Of this browser. */
export const browser = reached(() => localStorage);
