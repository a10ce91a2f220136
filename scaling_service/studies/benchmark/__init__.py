"""Tasks whose truth is known, for any program: inputs as files, answers as files, one table.

An entry is a folder ``TASK/CASE/`` of files that some program wrote: ``model.osim``, ``TRIAL.mot``,
``TRIAL_sd.mot`` (standard deviations, if the program states any), ``landmarks.json``, ``discovery.json``,
``answer.json``. Ours and OpenSim's are made in the same run and read by the same judges; models and motions
are read by OpenSim, never by our own kinematics.
"""
