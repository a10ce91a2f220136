"""What a service remembers: keys, subjects, files, jobs. It knows nothing of biomechanics.

Two places hold everything. A database (SQLite in the data directory, or PostgreSQL by URL) holds the
rows. The data directory holds the content of files, each once, named by its SHA-256::

    DATA/blobs/ab/cdef…      content of uploads and results, never changed once there
    DATA/scratch/uploads/    uploads on their way; locked while they are written
    DATA/scratch/jobs/       one folder for each attempt of a job that is running
    DATA/store.sqlite        the rows, unless a database URL is given

Rules that keep it whole, whoever is killed when:

- A file is written to scratch, synced and renamed; its row and every reference to it appear in one
  transaction that holds the row's lock while the file is put in place. The collector takes the same lock
  before it removes a file. So a row never refers to content that is not there, and content without a row
  is only ever rubbish.
- Every change of a job is one transaction that reads the job under a lock, asks the caller's rule, and
  writes. What is written is durable before the caller is answered.
- SQLAlchemy's Core, not its ORM: the few statements *are* the design (guarded updates, locks, keyset
  pages), and rows leave as frozen values that no session watches.
"""
