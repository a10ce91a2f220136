/** Signs on the floor: the laboratory's own axes, and where the person walks. */

import { ArrowHelper, CanvasTexture, Color, Group, Sprite, SpriteMaterial, Vector3 } from "three";

const AXES = [["x", "#D55E00"], ["y", "#009E73"], ["z", "#0072B2"]] as const;
const WALK = "#E69F00";

type Triple = [number, number, number];

/** The laboratory's axes x, y, z, turned as the recording was. */
export function triad(R_new_old: readonly Triple[]): Group {
  const group = new Group();
  AXES.forEach(([name, colour], column) => {
    const direction = new Vector3(...(R_new_old.map((row) => row[column]) as Triple));
    group.add(new ArrowHelper(direction, new Vector3(), 0.4, new Color(colour), 0.08, 0.05));
    group.add(written(`lab ${name}`, colour, direction.clone().multiplyScalar(0.5)));
  });
  return group;
}

export function arrow(direction: Triple): Group {
  const along = new Vector3(...direction).setY(0).normalize();
  const group = new Group();
  group.add(new ArrowHelper(along, new Vector3(), 1.2, new Color(WALK), 0.18, 0.1));
  group.add(written("walks", WALK, along.clone().multiplyScalar(1.35)));
  return group;
}

/** A short text that always faces the camera. */
function written(text: string, colour: string, at: Vector3): Sprite {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [192, 64];
  const context = canvas.getContext("2d");
  if (context !== null) {
    context.font = "600 40px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillStyle = colour;
    context.fillText(text, 96, 32);
  }
  const sprite = new Sprite(new SpriteMaterial({ map: new CanvasTexture(canvas), depthTest: false }));
  sprite.position.copy(at);
  sprite.scale.set(0.3, 0.1, 1);
  return sprite;
}
