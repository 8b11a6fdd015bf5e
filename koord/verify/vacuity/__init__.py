"""What makes verdicts say less than they seem to. [PROP-VACUOUS]"""
