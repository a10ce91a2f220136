"""Scaled models, motions, bones and documents onto disk.

``bones/<segment>.stl`` is a segment's bone in that segment's frame of the model, in **m**, as the image
shows it. ``bones.glb`` is the whole skeleton in the model's neutral standing pose, in ground, m, Y up (as
glTF asks); every bone is a node of its segment's name.
"""

from __future__ import annotations

import math
from collections import abc
from pathlib import Path

import numpy as np

from scaling_service.capabilities.motion import saving
from scaling_service.capabilities.motion.kinematic_error import KinematicError
from scaling_service.capabilities.playback.drawing import place_bones
from scaling_service.capabilities.playback.scene import INSIDE
from scaling_service.capabilities.scaling import clinical_gait, result
from scaling_service.capabilities.scaling.comparison import evidence
from scaling_service.capabilities.scaling.exporting import export_models
from scaling_service.capabilities.scaling.muscles import compare
from scaling_service.capabilities.scaling.muscles.surface import write_attachments
from scaling_service.capabilities.scaling.options import ComparisonOptions
from scaling_service.capabilities.scaling.run import render_scaled
from scaling_service.capabilities.scaling.scene import write_results_scene
from scaling_service.capabilities.scaling.words import summarise
from scaling_service.capabilities.subject import provenance
from scaling_service.core import errors
from scaling_service.core import progress as progressing
from scaling_service.documents import results as documents
from scaling_service.documents import writing
from scaling_service.files.model_json import write_model_json
from scaling_service.files.osim.models import replace_text
from scaling_service.model.body import to_vector
from scaling_service.model.freed import MARKERS_HELD
from scaling_service.model.poses import pose_neutral_frames
from scaling_service.model.results import Calibration
from scaling_service.model.trial import Bone
from scaling_service.report import onefile

_NUMBERS_ONLY = (
    "what markers do not show is nan in motions; OpenSim's tools read numbers only: files that end in "
    f"{saving.HELD} hold it at its neutral value for them"
)
_MM = 1e3
COLOUR = (227, 218, 201, 255)  # bone, as X11 and most atlases draw it

_BONES: abc.Mapping[str, documents.SegmentSource] = {"own": "bone", "other leg": "bone of the other leg"}


def save(
    results: result.Results,
    folder: str | Path,
    *,
    comparison: bool = True,
    report: bool = True,
    truth: documents.TruthDocument | None = None,
    progress: progressing.Progress | None = None,
) -> documents.ComparisonDocument:
    """Write results into a folder.

    Every method gets a folder of its name with ``model.osim``, ``model.json``, ``<trial>_ik.mot``,
    ``<trial>_clinical.csv`` and ``scaling.json``, ``clinical_angles.csv`` where there are gait cycles, and
    its bones where it is made from images; ``comparison.json`` and ``report.html`` stand beside them. All is
    written elsewhere first, so that a failure leaves the folder as it was.

    Parameters
    ----------
    results : Results
        From :func:`scale` or :func:`compare`.
    folder : path
        Made if it does not exist. Other files in it stay.
    comparison : bool
        Whether to write ``comparison.json`` and, with it, the report.
    report : bool
        Whether to write ``report.html``.
    truth : TruthDocument, optional
        Of a virtual person.
    progress : callable, optional
        Called with what is being done and the share that is done, 0 to 1.

    Returns
    -------
    ComparisonDocument
        What was, or would have been, written as ``comparison.json``: mm and degrees.

    Raises
    ------
    InputError
        The folder cannot be made or written to.

    Examples
    --------
    >>> import scaling_service as ss
    >>> document = ss.save(ss.scale("lab/subject.json", "MB"), "compared", report=False)
    >>> list(document.methods)
    ['MB']
    """
    tell, gait = progress or progressing.show_nothing, results.gait
    with writing.all_or_nothing(Path(folder)) as scratch:
        methods: dict[str, documents.MethodResult] = {}
        bare = [name for name, scaling in results.scalings.items() if scaling.osim is None]
        models = [results.scalings[name].calibration for name in bare]
        texts = dict(zip(bare, render_scaled(models, results.session), strict=True))
        for k, (method, scaling) in enumerate(results.scalings.items()):
            tell(f"{method}: writing", k / len(results.scalings))
            methods[method] = _write_method(
                scratch / method, scaling, gait[method], results, scaling.osim or texts[method]
            )
        document = make_comparison_document(results, methods, truth)
        for method, own in make_scaling_documents(document).items():
            writing.write_json(scratch / method / "scaling.json", own)
        if comparison:
            writing.write_json(scratch / "comparison.json", document)
        if comparison and report:
            tell("writing the report", 1.0)
            make_report(results, document).write(scratch)
    return document


def make_report(results: result.Results, document: documents.ComparisonDocument) -> onefile.Report:
    """``report.html``: the comparison's views with the models in all recordings."""
    files = onefile.collect_files(lambda folder: write_results_scene(results, folder, INSIDE))
    return onefile.Report(
        kind="scaling",
        name="comparison.json",
        summary=summarise(document),
        document=document,
        files=files,
        beside=[f"{name}/{file}" for name, method in document.methods.items() for file in method.files],
        vocabulary={"gait_angles": [word.model_dump() for word in clinical_gait.list_gait_angles()]},
    )


def _write_method(
    folder: Path,
    scaling: result.Scaling,
    gait: clinical_gait.ClinicalGait,
    results: result.Results,
    osim: str | errors.InputError,
) -> documents.MethodResult:
    """The method's files but for ``scaling.json``, and what that will say of it.

    ``osim``: the text of its ``model.osim``, or why there is none.
    """
    folder.mkdir()
    calibration, warnings = scaling.calibration, list[str]()
    write_model_json(folder / "model.json", calibration.model)
    for name, motion in scaling.motions.items():
        saving.write_motion(folder / f"{name}_ik.mot", motion, calibration.model)
    for name, tracked in scaling.followed.items():
        saving.write_motion(folder / f"{name}_ik.mot", tracked.motion, calibration.model)
        saving.write_motion_sd(
            folder / f"{name}_ik_sd.mot", tracked.motion, tracked.uncertainty.sd, calibration.model
        )
    if any(folder.glob(f"*{saving.HELD}")):
        warnings.append(_NUMBERS_ONLY)
    clinical_gait.write_clinical(folder, gait)
    if results.muscles is not None:
        compare.write_courses(folder, results.muscles.courses[calibration.method])
    text = None
    if isinstance(osim, str):
        text = osim
        replace_text(folder / "model.osim", text)
        if calibration.model.posterior is not None:
            warnings.append(MARKERS_HELD)
    elif isinstance(osim, errors.DependencyMissing | errors.ModelRefused):
        warnings.append(f"model.osim was not written: {osim}")
    else:
        raise osim
    if scaling.attachments:
        write_attachments(folder / "attachments.csv", scaling.attachments)
    if results.options.export:
        warnings += export_models(folder, calibration.model, text, results.options.export)
    if results.session.images is not None:
        write_bones(folder, calibration, results.session.images.bones)
    files = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    return make_method_document(scaling, results, gait, files, warnings)


def write_bones(folder: Path, calibration: Calibration, bones: abc.Mapping[str, Bone]) -> list[str]:
    """Write a method's bones beside its model; returns their files' names, none where there are no bones."""
    local = place_bones(calibration, bones)
    if not local:
        return []
    import trimesh  # only here: it takes a third of a second
    from trimesh.exchange.gltf import export_glb
    from trimesh.exchange.stl import export_stl
    from trimesh.visual import ColorVisuals

    (folder / writing.BONES).mkdir()
    frames, scene = pose_neutral_frames(calibration.model), trimesh.Scene()
    for name, bone in local.items():
        mesh = trimesh.Trimesh(bone.vertices, bone.faces, process=False)
        mesh.visual = ColorVisuals(mesh, face_colors=COLOUR)
        (folder / writing.BONES / f"{name}.stl").write_bytes(export_stl(mesh))
        transform = np.eye(4)
        transform[:3, :3], transform[:3, 3] = frames[name]
        scene.add_geometry(mesh, node_name=name, geom_name=name, transform=transform)
    (folder / writing.SKELETON).write_bytes(export_glb(scene))  # type: ignore[no-untyped-call]
    return [*(f"{writing.BONES}/{name}.stl" for name in local), writing.SKELETON]


def make_comparison_document(
    results: result.Results,
    methods: dict[str, documents.MethodResult],
    truth: documents.TruthDocument | None,
) -> documents.ComparisonDocument:
    """``comparison.json``."""
    session, settings = results.session, results.settings
    trials = [trial for trial in (session.static, *session.dynamic) if trial is not None]
    chosen = {"comparison": results.options.resolved()} if results.options != ComparisonOptions() else {}
    return documents.ComparisonDocument(
        **provenance.record_provenance(results.loaded, trials, settings.resolved() | chosen, settings.seed),
        sizes=provenance.read_stated_sizes(session.subject),
        verdict=results.verdict,
        methods=methods,
        warnings=list(results.warnings),
        wall_s=round(results.wall_s, 3),
        truth=truth,
        muscles=None if results.muscles is None else compare.make_muscle_document(results.muscles),
    )


def make_scaling_documents(document: documents.ComparisonDocument) -> dict[str, documents.ScalingDocument]:
    """``scaling.json`` of each method; the warnings of the whole session stand before the method's own."""
    shared = {name: getattr(document, name) for name in documents.Provenance.model_fields}
    return {
        name: documents.ScalingDocument(
            **shared, **dict(method) | {"warnings": [*document.warnings, *method.warnings]}
        )
        for name, method in document.methods.items()
    }


def make_method_document(
    scaling: result.Scaling,
    results: result.Results,
    gait: clinical_gait.ClinicalGait,
    files: abc.Sequence[str] = (),
    warnings: abc.Sequence[str] = (),
) -> documents.MethodResult:
    """One method's results, with the files and warnings that writing them added."""
    calibration, shape = scaling.calibration, scaling.geometry
    fitted = evidence.average_errors(scaling.errors, [trial.name for trial in results.session.calibration])
    held_out = evidence.average_errors(scaling.errors, results.held_out)
    # What sized each segment; the size of one that nothing was measured of is that of persons alike.
    lengths = {p.target for p in calibration.parameters if p.group == "length"}
    found: dict[str, documents.SegmentSource] = {}
    for name in calibration.model.segment_names:
        size = calibration.sizes.get(name)
        if name in calibration.bone_sized:
            found[name] = _BONES[calibration.bone_sized[name]]
        elif name in lengths:
            found[name] = "movement"
        else:
            found[name] = "markers" if size is None or size.own else "persons alike"
    return documents.MethodResult(
        method=calibration.method,
        kinematic_error_mm={
            name: _make_error(error, held_out=name in results.held_out)
            for name, error in scaling.errors.items()
        },
        fitted_mean_mm=None if fitted is None else _MM * fitted.mean,
        held_out_mean_mm=None if held_out is None else _MM * held_out.mean,
        held_out_ratio=None
        if fitted is None or held_out is None or fitted.mean <= 0.0
        else held_out.mean / fitted.mean,
        segment_lengths_mm={name: _MM * length for name, length in shape.lengths.items()},
        length_estimates=_list_length_estimates(calibration, shape.lengths),
        segment_sources=found,
        joint_centres_mm={
            name: documents.JointCentre(
                frame=frame,
                xyz=to_vector(_MM * x for x in at),
                sd_mm=to_vector(_MM * sd for sd in calibration.centres[name].sd)
                if name in calibration.centres
                else None,
            )
            for name, (frame, at) in shape.joint_centres.items()
        },
        knee_axis_deg={
            side: documents.KneeAxis(x=math.degrees(x), y=math.degrees(y))
            for side, (x, y) in shape.knee_axes.items()
        },
        marker_shift_mm={name: _MM * shift for name, shift in shape.marker_shifts.items()},
        scale_factors=dict(calibration.scale_factors),
        parameters=[
            documents.FittedParameter(
                name=p.name,
                value=p.value,
                unit=p.unit,
                sd=p.sd if calibration.model.posterior is not None and math.isfinite(p.sd) else None,
                at_bound=p.at_bound,
                identifiable=p.identifiable,
            )
            for p in calibration.parameters
        ],
        cumulative_error_mm2=None if math.isnan(calibration.cost) else round(calibration.cost * 1e6, 2),
        iterations=calibration.iterations,
        wall_s=documents.WallTime(
            calibration=calibration.wall_s, inverse_kinematics=scaling.inverse_kinematics_s
        ),
        clinical=clinical_gait.make_clinical_document(gait),
        warnings=[*calibration.warnings, *warnings],
        files=list(files),
    )


def _list_length_estimates(
    calibration: Calibration, lengths: abc.Mapping[str, float]
) -> dict[str, documents.LengthEstimate]:
    """By name of the length; a planar model's has no side and is estimated as the right one."""
    sizes = {size.dimension: size for size in calibration.sizes.values()}
    found = {name: sizes.get(name) or sizes.get(f"{name}_r") for name in lengths}
    return {
        name: documents.LengthEstimate(
            sd_mm=_MM * size.sd * lengths[name],
            measured=size.measured,
            others=size.others,
            expected=size.expected,
        )
        for name, size in found.items()
        if size is not None
    }


def _make_error(error: KinematicError, *, held_out: bool) -> documents.TrialError:
    return documents.TrialError(
        role="evaluation" if held_out else "calibration",
        mean=_MM * error.mean,
        sd=_MM * error.sd,
        rms=_MM * error.rms,
        max=_MM * error.max,
        anatomical_mean=_MM * error.anatomical_mean,
        tracking_mean=_MM * error.tracking_mean,
        frames=error.n_frames,
        per_marker={name: _MM * value for name, value in error.per_marker.items()},
    )
