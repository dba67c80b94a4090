"""Reports for people: HTML files with everything inside, right on a screen, on a phone and on paper."""
