"""One viewer of a drill: live, recorded and frozen.

A live drill is a recording that still grows, a recording is a live drill with a playhead, and a
report is a recording that is frozen into one file. The browser shows all three on one screen.

=============  ====================================================================================
module         what it holds
=============  ====================================================================================
``frames``     what travels to the browser: a header and arrays, in bytes
``impacts``    impacts of a run, and their spread over any range of time
``bins``       least, mean and greatest value of signals over a run, in bins that grow with it
``server``     server of the screen: this machine alone, or others with a token
``live``       a running drill: what was heard of it, and actions on it
``recorded``   a bag: its clocks, its signals, its exact waveform
``frozen``     report of a bag: the screen and its data in one file
``share``      the screen itself: HTML, CSS and ES modules, one a concept
=============  ====================================================================================
"""
