"""Coverage study: do intervals hold the truth as often as they say, over all fits and over those called ok?"""
