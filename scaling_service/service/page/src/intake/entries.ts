/** What was dropped or chosen: files with their paths, folders opened. */

export interface Entry {
  /** With folders, `/` between them. */
  path: string;
  file: File;
}

export const baseName = (path: string): string => path.slice(path.lastIndexOf("/") + 1);

export const folderOf = (path: string): string => path.slice(0, path.lastIndexOf("/") + 1);

/** Files as an input gives them. */
export function chosenEntries(files: FileList): Entry[] {
  return [...files].map((file) => ({ path: file.webkitRelativePath || file.name, file })).filter(isWanted);
}

/** Files of a drop, those of dropped folders too. */
export async function droppedEntries(transfer: DataTransfer): Promise<Entry[]> {
  const roots = [...transfer.items].map((item) => item.webkitGetAsEntry()).filter((entry) => entry !== null);
  const found = await Promise.all(roots.map((entry) => below(entry)));
  return found.flat().filter(isWanted);
}

async function below(entry: FileSystemEntry): Promise<Entry[]> {
  if (entry.isFile) {
    const file = await new Promise<File>((resolve, reject) => (entry as FileSystemFileEntry).file(resolve, reject));
    return [{ path: entry.fullPath.replace(/^\//, ""), file }];
  }
  const reader = (entry as FileSystemDirectoryEntry).createReader();
  const children: FileSystemEntry[] = [];
  for (;;) {
    const some = await new Promise<FileSystemEntry[]>((resolve, reject) => reader.readEntries(resolve, reject));
    if (some.length === 0) break;
    children.push(...some);
  }
  return (await Promise.all(children.map(below))).flat();
}

/** Not what systems leave in folders. */
function isWanted({ path, file }: Entry): boolean {
  return !baseName(path).startsWith(".") && file.name !== "Thumbs.db";
}
