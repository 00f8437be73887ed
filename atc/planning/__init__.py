"""What is to be computed, how, and what that will cost: before anything is.

``request``         what is asked, as plain checked data
``job``             a request made ready: frames, settings, and the method of each deposit
``method_choice``   the cheapest method that keeps the promise; ``error_forecast``: how far above the tolerance it may
begin
``costs``           what things cost; ``calibrate`` measures that on this machine, ``predict`` adds it up
``report``          what is going to be done, for people (``atc plan``)
``identity``        what makes a run that goes on the same run
"""
