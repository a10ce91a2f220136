"""From a request to a result that is kept, whatever happens on the way.

``service`` is what the HTTP layer calls. ``submission`` makes or finds the job that a request is, ``machine``
is the states of a job as one pure function, ``ledger`` changes jobs by it, each time in one transaction. A
``runner``, in a ``process`` of its own, takes queued jobs and has them done as ``attempts``.

How an attempt goes. A runner leases a job: the attempt's number grows and is the fencing token. It copies
the inputs into the attempt's folder and submits ``attempts.Order`` to its executor. There a supervisor
starts a child, which is forked from a warm process (the package is imported already) and limits
itself before it touches a foreign byte. Child and supervisor talk over a pipe in JSON only. Supervisor and
runner talk through the attempt's folder only, so that the executor may be on another machine with the
same data directory. When the child is done, the runner puts the files in place and the result into the
database in one transaction, which succeeds only if the job is still leased under the same attempt.

A batch is a job that is made of others, one for each member (``kinds.Parts``). They are asked for with it in
one transaction and then are jobs like any: leased by any runner, lost and taken back alone, kept as soon as
they are done. The whole waits, and counts them; when the last one is over, however it ended, its own
work puts together what they made. So nothing that was finished is computed again, whoever is killed when.

Who dies when: a child is killed by the kernel when its supervisor dies; a supervisor stops its child when
the attempt's heartbeat stops; a runner that dies loses its leases in time, and any runner takes the jobs
back. Nothing that is lost counts as done, and nothing is done twice in the store.
"""
