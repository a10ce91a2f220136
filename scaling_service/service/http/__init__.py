"""The service over HTTP: it takes requests apart, asks ``runner.service``, and puts answers together.

The parts, each one idea:

=============== ====================================================================================
``app``         all of it as one ASGI application
``problems``    errors as RFC 9457 documents, in the words of the command line
``bodies``      reading what a client sends: JSON with bounds, or chunks of a file
``callers``     whose request it is: the owner of the key, or of the machine
``buckets``     how many requests a caller may make
``conditional`` ETag and If-None-Match
``subjects``    routes of subjects and their files
``examples``    something to try; ``words`` tells the names that are used
``markers``     the labels of a laboratory
``asking``      one route for each row of the table of kinds (``runner.kinds``)
``jobs``        routes of jobs
``events``      a job's progress as server-sent events
``links``       links that work for a minute without a key, by ``tickets``
``contents``    stored files and archives, streamed; ``ranges`` of them
``monitoring``  health, readiness, metrics
``shield``      a defect ends as a problem document, too
``watching``    around every request: its log line, its measurements, the headers of its answer
``threads``     where writers wait for each other without holding up readers
``openapi``     the document of all routes; ``page`` shows it to people
``site``        the web page, bundled from the sources in ``web``
``serving``     from settings to a server that runs, and its end
=============== ====================================================================================

Nothing here computes or waits in the event loop: the store is asked in threads, jobs run in the runner's
processes.
"""
