"""Frequency responses and modal models."""
