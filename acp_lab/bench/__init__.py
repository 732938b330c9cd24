"""The comparison lab: methods and outside trackers on the same frames, by one protocol.

    protocol    what a run is: a data set's object, a method, a start, a frame step, resets
    runner      one run, frame by frame
    record      what is kept of it, one file per run
    touched     what tells that data was changed since
    workers     many calls of a function, over processes or a cluster
    spread      many runs, kept and new
    outside     results files of other trackers as runs
    tables      scores per group, intervals, paired differences
    basins      from how far off a start trackers still come to the part
    peers       the trackers of the paper's tables, and where their rows come from
"""
