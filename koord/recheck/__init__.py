"""An independent check of proofs: obligations made anew from a certificate, for another solver.

Nothing here knows the evaluator of ``koord.semantics`` or the encoding of ``koord.verify``: what
is checked twice is to be thought of twice. The argument is ``specs/certificates/README.md``.
"""
