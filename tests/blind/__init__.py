"""The blind bank: recordings in which an effect is hidden, made by another engine than the product's.

Nothing here imports what computes kinematics or dynamics in ``scaling_service``: bodies are this folder's
own tables, motion and forces come from Pinocchio, the files are written here. The product sees a subject
file, an ``.osim`` model, TRC and MOT (or C3D) files, as from any user. What was hidden lies elsewhere, under
``labels``, and names of folders and trials tell nothing of it.

- ``python -m tests.blind.make --out BANK --fast|--full`` writes the bank;
- ``python -m tests.blind.real.make --out BANK`` adds real recordings with something hidden; with ``--bones``
  the walking person with imaged bones, for a bank of its own, run with ``--start EB_am``;
- ``python -m tests.blind.run --bank BANK --out RESULTS`` lets the product look for what is hidden;
- ``python -m tests.blind.score --bank BANK --results RESULTS`` prints how well it did; with
  ``--records FILE`` every case is kept in one line of that file, with a fingerprint of the search, so that
  runs can be put together.

Each goes on where it stopped.

Signs are those of the design, section 6. Where that leaves room, this bank has it so:

- ``segment_length``: all places in the segment's frame times the factor, masses unchanged;
- ``soft_tissue_artefact``, ``coupled_motion``: times the driver in degrees from its zero, not from its mean;
- ``skin_wobble``: displacement against the place on the segment, isotropic, without the sag under gravity;
- ``plate_position``, ``plate_rotation``: where the plate truly is minus where the file has it, so that
  readings are off by the opposite; a rotation is about the mean centre of pressure of each trial;
- ``plate_bias``: what is added to the readings, at the mean centre of pressure of each trial;
- ``segment_mass``: the inertia changes in proportion; ``segment_com``: the inertia about it stays;
- ``gravity_tilt``: the true vertical is the file's Y turned by the vector (x, 0, z);
- ``marker_swap``, ``external_contact``: the same interval in every trial, or (half of them) in the first
  calibration trial only.
"""
