"""The service over HTTP: it takes requests apart, asks ``jobs.service``, and puts answers together.

The parts, each one idea:

================= ==================================================================================
``app``           all of it as one ASGI application
``problems``      errors as RFC 9457 documents, in the words of the command line; a defect is one, too
``bodies``        reading what a client sends, and threads for what it writes
``callers``       whose request it is, by key or ticket, and how many requests a caller may make
``contents``      stored files and archives, streamed, in stretches, known by ETag; links to them
``subjects``      routes of subjects and their files
``laboratory``    routes of what a laboratory has: names, labels of markers, an example to try
``jobs``          routes of jobs: one that asks for each row of the table of kinds, progress as events
``monitoring``    health, readiness, metrics; around every request its log line and its headers
``documentation`` the OpenAPI document of all routes, for programs and for people
``site``          the web page, bundled from the sources in ``page``
``serving``       from settings to a server that runs, and its end
================= ==================================================================================

Nothing here computes or waits in the event loop: the store is asked in threads, jobs run in the runner's
processes.
"""
