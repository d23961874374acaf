"""Reads videos for the tests."""
import cv2


def images_of(video):
    """All its images, BGR."""
    capture, images = cv2.VideoCapture(str(video)), []
    while (read := capture.read())[0]:
        images.append(read[1])
    return images
