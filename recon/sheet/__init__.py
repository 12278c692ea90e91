"""The printed sheet that tells real size, floor and up: how it looks (layout, drawing), and where it is in a photo.

python -m recon.sheet --paper A4 --out sheet.pdf
"""
