"""Digital Calibration Certificates: written, checked against schemas, signed, verified, and shown as a page."""

__all__ = ["content", "dcc", "keys", "page", "quantities", "schemas", "signature", "verification", "xml_form"]
