"""One viewer of a drill: live, recorded and frozen.

A live drill is a recording that still grows, a recording is a live drill with a playhead, and a
report is a recording that is frozen into one file. The browser shows all three on one screen.

=============  ====================================================================================
module         what it holds
=============  ====================================================================================
``server``     server of the screen: this machine alone, or others with a token
``session``    one browser: what it looks at, what it has acknowledged, what it asks for
``store``      what a server shows: ``live`` or ``recorded``
``frames``     what travels to the browser: a header and arrays, in bytes
``plots``      plots of a drill, and which quantities they need
``commands``   commands of a run in words, and as stepped lines
``impacts``    impacts of a run, and their spread over any range of time
``bins``       least, mean and greatest value of signals over a run, in bins that grow with it
``picture``    what is drawn of a drill: layers, numbers of a second, the hole
``live``       running drills: what was heard of them, and actions on them
``recorded``   a bag: its clocks, its signals, its exact waveform
``frozen``     report of a bag: the screen and its data in one file
``share``      the screen itself: HTML, CSS and ES modules, one a concept
=============  ====================================================================================
"""
