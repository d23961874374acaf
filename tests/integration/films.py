"""Videos as tests look at them."""
import cv2


def pictures_of(video):
    """All its pictures, BGR."""
    film, pictures = cv2.VideoCapture(str(video)), []
    while (read := film.read())[0]:
        pictures.append(read[1])
    return pictures
